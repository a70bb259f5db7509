"""What the wheel holds: each folder below under its import name, with all that lies in it, found and not listed.

Data files are what MANIFEST.in names. A folder that the tree lacks is left out. A checkout that is installed in place
has `hapscene_evidence` too; the wheel has not.
"""

import sys
from pathlib import Path

from setuptools import find_packages, setup

FOLDERS = {
    "hapscene": "hapscene",
    "hapscene_plugins": "plugins",
    "hapscene_assets": "assets",
    "hapscene_swatches": "swatches",
}
if "editable_wheel" in sys.argv:
    FOLDERS["hapscene_evidence"] = "evidence"

present = {name: folder for name, folder in FOLDERS.items() if Path(folder, "__init__.py").is_file()}
packages = [f"{name}.{below}" for name, folder in present.items() for below in find_packages(folder)]
setup(packages=[*present, *packages], package_dir=present)
