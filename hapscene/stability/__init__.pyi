from . import closed_form as closed_form
from .critical import critical_stiffness as critical_stiffness
