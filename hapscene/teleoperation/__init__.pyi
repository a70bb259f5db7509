from .endpoint import Coupling as Coupling
from .operation import Impairment as Impairment
from .operation import Operation as Operation
from .operation import OperationResult as OperationResult
