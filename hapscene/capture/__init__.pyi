from .io.hatt import import_hatt as import_hatt
from .io.hjif import export_hjif as export_hjif
from .io.recording import SurfaceRecording as SurfaceRecording
from .io.recording import load_recording as load_recording
from .record.time_alignment import join as join
from .swatch_fit import fit as fit
from .synthesis import synthesize as synthesize
