from .picture import write_picture as write_picture
from .plot import draw_plot as draw_plot
from .sound import write_wave as write_wave
