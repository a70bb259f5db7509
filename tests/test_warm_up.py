"""Each feature is used once in advance."""

import pytest

from hapscene import warm_up
from hapscene.compiled.native import INTERPRETED, Native

USED = {
    "_touch": "run_ticks place_proxy pack_faces",
    "_touch_with_everything": "run_ticks fit_cylinders _sort_faces",
    "_close_the_loop": "run_ticks hold_omni slopes_at",
    "_serve": "_beat begin_safety resume_safety drive_arm _store now_ns",
    "_teleoperate": "operate set_start find_tip",
    "_play_on_handle": "run _advance write render _learn_all run_texture",
    "_paint": "first_face mark_hidden_points signed_distance",
}


@pytest.mark.timeout(600)  # with an empty cache, it compiles everything
@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")
def test_compiled_functions_of_all_features_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    used, whole = {"before": set[str]()}, Native.__dict__["whole"].func

    def noted(self: Native) -> object:
        list(used.values())[-1].add(self.py_func.__name__)
        if "whole" not in self.__dict__:
            self.__dict__["whole"] = whole(self)
        return self.__dict__["whole"]

    monkeypatch.setattr(Native, "whole", property(noted))
    for name in USED:
        part = getattr(warm_up, name)
        monkeypatch.setattr(
            warm_up, name, lambda *scene, name=name, part=part: (used.update({name: set()}), part(*scene))
        )
    warm_up.warm_up()
    assert not {name: missing for name, names in USED.items() if (missing := set(names.split()) - used[name])}
