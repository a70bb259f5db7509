from .hand_intent import Intent as Intent
from .twin import Twin as Twin
from .twin_recording import Feel as Feel
