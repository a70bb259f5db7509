from .picture import write_picture as write_picture
from .plot import draw_plot as draw_plot
from .plot import write_plot as write_plot
from .sound import write_sound as write_sound
