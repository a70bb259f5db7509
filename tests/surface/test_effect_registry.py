"""Effects are found through entry points; a broken plugin is named and harms no other."""

import sys

import pytest

from hapscene.errors import EffectError
from hapscene.surface import effect_registry
from hapscene.surface.effect_registry import listed, load_effect

GOOD = "from hapscene.surface.effect import Effect\nEFFECT = Effect('{}', 'Does nothing.', lambda *a: None)\n"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Puts a package with one module and entry points of the group onto the path, as pip would."""

    def put(package: str, source: str, **points: str) -> None:
        site = tmp_path / package
        info = site / f"{package}-2.5.dist-info"
        info.mkdir(parents=True)
        (site / f"{package}.py").write_text(source)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 2.5\n")
        lines = "\n".join(f"{name} = {target}" for name, target in points.items())
        (info / "entry_points.txt").write_text(f"[{effect_registry.GROUP}]\n{lines}\n")
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, package, raising=False)

    return put


def test_ours_are_listed():
    entry = listed()["wall"]
    assert entry.plugin.name == "wall" and entry.error is None
    assert entry.distribution == "hapscene" and entry.version
    assert entry.module == "hapscene_plugins.effects.wall"
    assert list(listed()) == sorted(listed())


def test_somebody_else_s_is_listed(install):
    install("others_hum", GOOD.format("hum"), hum="others_hum:EFFECT")
    entry = listed()["hum"]
    assert (entry.distribution, entry.version, entry.module) == ("others_hum", "2.5", "others_hum")
    assert load_effect("hum") is entry.plugin


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import nothing_of_that_name\n", "ModuleNotFoundError: No module named 'nothing_of_that_name'"),
        ("EFFECT = (\n", "SyntaxError"),
        ("raise ValueError('no luck')\n", "ValueError: no luck"),
        ("OTHER = 1\n", "AttributeError"),
        ("EFFECT = 42\n", "expected an Effect there, found int"),
        (GOOD.format("other"), "calls itself 'other'"),
    ],
)
def test_broken_one_is_named_and_the_others_live(install, source, said):
    install("others_broken", source, broken="others_broken:EFFECT")
    entries = listed()
    assert entries["wall"].plugin is not None
    assert entries["broken"].plugin is None
    assert said in entries["broken"].error and "others_broken 2.5" in entries["broken"].error
    with pytest.raises(EffectError, match=r"effect 'broken' of others_broken 2\.5"):
        load_effect("broken")


def test_offered_twice_is_refused(install):
    install("others_wall", GOOD.format("wall"), wall="others_wall:EFFECT")
    with pytest.raises(EffectError, match=r"offered twice, by hapscene .* and others_wall 2\.5 .*uninstall"):
        load_effect("wall")
    entries = listed()
    assert entries["wall"].plugin is None and "offered twice" in entries["wall"].error
    assert entries["friction"].plugin is not None


def test_unknown_says_what_there_is():
    with pytest.raises(EffectError, match=r"no effect 'wal'; there are: .*friction, .*wall.*\. Did you mean 'wall'\?"):
        load_effect("wal")
