from . import closed_form as closed_form
