from .hatt import export_hatt as export_hatt
from .hatt import import_hatt as import_hatt
from .hjif import export_hjif as export_hjif
from .recording_file import SurfaceRecording as SurfaceRecording
from .recording_file import load_recording as load_recording
from .recording_join import join as join
from .swatch_fit import fit as fit
from .synthesis import synthesize as synthesize
