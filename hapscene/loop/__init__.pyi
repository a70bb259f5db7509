from .reference_trajectory import ReferenceTrajectory as ReferenceTrajectory
from .result import ClosedLoopResult as ClosedLoopResult
from .servo import Servo as Servo
from .servo_state import ServoState as ServoState
from .session_log import Replay as Replay
from .session_log import SessionLog as SessionLog
from .timing import TimingStatistics as TimingStatistics
from .twin import Twin as Twin
