from .servo import Servo as Servo
from .servo import ServoState as ServoState
from .servo import TimingStatistics as TimingStatistics
from .session_log import Replay as Replay
from .session_log import SessionLog as SessionLog
