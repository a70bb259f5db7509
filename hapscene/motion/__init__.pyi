from .gestures import act as act
from .hand_path import explore as explore
from .look_from_above import look_from_above as look_from_above
from .path_file import load_path as load_path
