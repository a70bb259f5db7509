from .format_registry import export_scene as export_scene
from .format_registry import import_scene as import_scene
from .format_registry import losses as losses
from .format_registry import painted_scene as painted_scene
