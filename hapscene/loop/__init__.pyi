from .hand_intent import Intent as Intent
from .result import Feel as Feel
from .servo import Servo as Servo
from .servo import ServoState as ServoState
from .servo import TimingStatistics as TimingStatistics
from .session_log import Replay as Replay
from .session_log import SessionLog as SessionLog
from .twin import Twin as Twin
