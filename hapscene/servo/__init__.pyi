from .flight_recorder import Flight as Flight
from .flight_recorder import Replay as Replay
from .servo import Servo as Servo
from .servo import ServoState as ServoState
from .servo_loop import Lateness as Lateness
