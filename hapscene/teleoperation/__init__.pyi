from .endpoint import Coupling as Coupling
from .link import Impairment as Impairment
from .operation import Operated as Operated
from .operation import Operation as Operation
