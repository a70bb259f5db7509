from .plan import Plan as Plan
from .plan import load_plan as load_plan
from .plan import parse_plan as parse_plan
from .sitting import Sitting as Sitting
from .statistics import analyse as analyse
