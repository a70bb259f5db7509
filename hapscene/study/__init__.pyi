from .plan import Plan as Plan
from .plan import load_plan as load_plan
from .plan import parse_plan as parse_plan
from .session import Session as Session
from .statistics import analyse as analyse
