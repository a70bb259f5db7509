from .hand_intent import Intent as Intent
from .result import Feel as Feel
from .twin import Twin as Twin
