from .fit.swatch import FitOptions as FitOptions
from .fit.swatch import fit_swatch as fit_swatch
from .fit.synthesis import synthesize as synthesize
from .io.hatt import import_hatt as import_hatt
from .io.recording import SurfaceRecording as SurfaceRecording
from .io.recording import load_recording as load_recording
from .time_alignment import join as join
