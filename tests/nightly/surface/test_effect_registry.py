"""Loading one effect imports no other."""

import subprocess
import sys


def test_only_the_loaded_effect_is_imported():
    code = (
        "import sys; from hapscene.surface.effect import load_effect; load_effect('wall');"
        "print([m for m in sys.modules if m.startswith('hapscene_plugins.effects.')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['hapscene_plugins.effects.wall']"
