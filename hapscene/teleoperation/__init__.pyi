from .endpoint import Coupling as Coupling
from .experiment import write_experiment as write_experiment
from .link import Impairment as Impairment
from .operation import Operated as Operated
from .operation import Operation as Operation
