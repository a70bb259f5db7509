"""Effects are found through entry points; a broken plugin is reported and does not affect others."""

import sys

import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.errors import EffectError
from hapscene.surface.effect import EFFECTS, Effect, load_effect
from hapscene.surface.effect_compile import compile_effect

GOOD = "from hapscene.surface.effect import Effect\nEFFECT = Effect('{}', 'Does nothing.', lambda *a: None)\n"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a package with one module and entry points, as pip would."""

    def put(package: str, source: str, **points: str) -> None:
        site = tmp_path / package
        info = site / f"{package}-2.5.dist-info"
        info.mkdir(parents=True)
        (site / f"{package}.py").write_text(source)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 2.5\n")
        lines = "\n".join(f"{name} = {target}" for name, target in points.items())
        (info / "entry_points.txt").write_text(f"[{EFFECTS.group}]\n{lines}\n")
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, package, raising=False)

    return put


def test_shipped_effects_are_listed():
    entry = EFFECTS.listed()["wall"]
    assert entry.plugin.name == "wall" and entry.error is None
    assert entry.distribution == "hapscene" and entry.version
    assert entry.module == "hapscene_plugins.effects.wall"
    assert list(EFFECTS.listed()) == sorted(EFFECTS.listed())


def test_third_party_effect_is_listed(install):
    install("others_hum", GOOD.format("hum"), hum="others_hum:EFFECT")
    entry = EFFECTS.listed()["hum"]
    assert (entry.distribution, entry.version, entry.module) == ("others_hum", "2.5", "others_hum")
    assert load_effect("hum") is entry.plugin


@pytest.mark.parametrize(
    "source",
    [
        "EFFECT = (\n",
        "raise ValueError('no luck')\n",
        "OTHER = 1\n",
        "EFFECT = 42\n",
        GOOD.format("other"),
    ],
)
def test_a_broken_plugin_is_named_and_the_others_work(install, source):
    install("others_broken", source, broken="others_broken:EFFECT")
    entries = EFFECTS.listed()
    assert entries["wall"].plugin is not None
    assert entries["broken"].plugin is None and "others_broken 2.5" in entries["broken"].error
    with pytest.raises(EffectError, match="others_broken"):
        load_effect("broken")


def test_name_of_two_packages_is_rejected(install):
    install("others_wall", GOOD.format("wall"), wall="others_wall:EFFECT")
    with pytest.raises(EffectError, match="others_wall"):
        load_effect("wall")
    assert EFFECTS.listed()["wall"].plugin is None and EFFECTS.listed()["friction"].plugin is not None


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")
def test_an_effect_that_does_not_compile_is_refused_in_one_line():
    def misspelt(touch, p, table, s, out):
        out.f_W_N[0] = touch.no_such_field

    def untyped(touch, p, table, s, out):
        out.f_W_N[0] = touch.depth_m + "unsupported"

    named = {misspelt: "no_such_field", untyped: "", print: "print"}
    for bad, name in named.items():
        with pytest.raises(EffectError, match="'bad'") as caught:
            compile_effect(Effect("bad", "Fails.", bad))
        said = str(caught.value)
        assert "\n" not in said and "nopython" not in said and ";;" not in said and "; ;" not in said
        assert name in said and len(said.partition("does not compile: ")[2]) <= 600
        assert bad is print or f"{__file__}:{bad.__code__.co_firstlineno}" in said


def test_an_unknown_effect_is_refused():
    with pytest.raises(EffectError, match="'wal'"):
        load_effect("wal")
