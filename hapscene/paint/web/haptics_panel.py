"""The tab Haptics: device, grip and handle of the simulated hand, and the parameters of the selected swatch."""

import math
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import Any, Final

from hapscene.errors import SwatchError
from hapscene.paint.model.composing import numbered
from hapscene.paint.model.tuning import Parameter
from hapscene.paint.web.context import ClientContext, Control, PageContext, bounded, card_html, escape_html, set_html
from hapscene.paint.web.hand import COMPENSATOR_HINTS, GRIP_NAMES, HAND_DEVICES

__all__ = ["HandPanel", "ParameterPanel"]


LAST: Final = 1e9
"""Order of the folder below all others of the tab."""


class HandPanel:
    """Controls for device, grip and handle."""

    def __init__(self, context: PageContext, container: AbstractContextManager[object]) -> None:
        self._context = context
        gui, callback, config = context.gui, context.callback, context.touch.config
        with container, gui.add_folder("Simulated hand", order=LAST):
            device = gui.add_dropdown(
                "Device",
                tuple(HAND_DEVICES),
                initial_value=config.device,
                hint="Haptic device that the hand holds, with its limits. omni models the whole arm with friction, "
                "compliance and motors; the others are a point mass with friction and an unlimited workspace",
            )
            grip = gui.add_dropdown("Grip", GRIP_NAMES, initial_value=config.grip, hint="Firmness of the grip")
            handle = gui.add_dropdown(
                "Handle",
                tuple(COMPENSATOR_HINTS),
                initial_value=config.compensator,
                hint="Compensator of the haptography handle, which plays textures and taps; or no handle",
            )
            self._output = gui.add_html("")
        context.session.tuning.choose_device(config.limits)
        device.on_update(callback(partial(self._choose, "device")))
        grip.on_update(callback(self._choose_grip))
        handle.on_update(callback(partial(self._choose, "compensator")))
        self._show_output()

    def _show_output(self) -> None:
        hint = COMPENSATOR_HINTS[self._context.touch.config.compensator]
        self._output.content = card_html(f"Sound and plots show {escape_html(hint)}.")

    def _choose_grip(self, target: Control) -> None:
        touch = self._context.touch
        touch.config = replace(touch.config, grip=target.value)

    async def _choose(self, what: str, target: Control) -> None:
        """Change the device or the handle, which restarts the hand."""
        session, touch = self._context.session, self._context.touch
        touch.config = replace(touch.config, **{what: target.value})
        session.tuning.choose_device(touch.config.limits)
        self._show_output()
        self._context.refresh()  # shows the new limits
        if touch.status != "closed":
            await touch.open(session.painting.snapshot())


PLAIN: Final = ("stiffness_N_m", "texture_gain", "friction_dynamic", "damping_Ns_m", "tap_gain")
"""Parameters that are shown first; the others are in the folder Expert."""

STEP_COUNT: Final = 200
"""Approximate number of steps of a slider [count]: at its middle, finer than 2 % of the value."""

FIGURES: Final = 4
"""Significant digits shown in a field [count]."""

NAME_MAX: Final = 24
"""Longest name that fits above the sliders [characters]."""


class ParameterPanel:
    """Sliders for the parameters of the selected swatch."""

    def __init__(self, context: ClientContext, container: AbstractContextManager[object]) -> None:
        self._context = context
        self._container = container
        self._shown: tuple[object, ...] = ()
        self._sliders: dict[str, Control] = {}
        with container:
            self._head = context.gui.add_html("")
            self._folder: Any = None
        self.show()

    def show(self) -> None:
        """Update the sliders from the swatch, and rebuild them if another swatch is selected."""
        context = self._context
        index = context.tools.swatch
        if index is None:  # the scene does not use it yet, or no longer after an undo
            chosen = escape_html(context.tools.chosen)
            self._clear(f"Paint with <b>{chosen}</b> to edit its parameters here.")
            return
        found = [p for p in context.session.tuning.parameters(index) if p.applies]
        swatch = context.session.scene.swatches[index]
        shape = (index, swatch.name, context.session.tuning.device, *((p.name, p.minimum, p.maximum) for p in found))
        if shape != self._shown:
            self._make(found, swatch.name)
            self._shown = shape
        device = escape_html(context.session.tuning.device)
        text = (
            f": changes take effect at once, also where the swatch is painted. The limits of the {device} apply."
            if found
            else " is the default of unpainted faces and cannot be changed. You can tune a copy."
        )
        notes = "".join(f"<br>⚠ {escape_html(p.note)}" for p in found if p.note)
        set_html(self._head, card_html(f"<b>{escape_html(swatch.name)}</b>{text}{notes}"))
        for p in found:
            slider = self._sliders[p.name]
            if slider.value != _rounded(p.value):
                slider.value = _rounded(p.value)

    def _make(self, found: list[Parameter], name: str) -> None:
        gui, callback = self._context.gui, self._context.callback
        self._clear()
        with self._container:
            self._folder = gui.add_folder(
                f"Parameters of {name if len(name) <= NAME_MAX else name[: NAME_MAX - 1] + '…'}"
            )
            with self._folder:
                expert = gui.add_folder("Expert", expand_by_default=False, order=LAST) if found else self._folder
        for p in sorted(found, key=lambda p: PLAIN.index(p.name) if p.name in PLAIN else len(PLAIN)):
            with self._folder if p.name in PLAIN else expert:
                step = _step(p.maximum - p.minimum)
                unit = "" if p.unit in ("1", "") else f" [{p.unit}]"
                slider = gui.add_slider(
                    _capital(p.label) + unit,
                    min=min(p.minimum, _rounded(p.value)),
                    max=max(math.floor(p.maximum / step + 1e-9) * step, _rounded(p.value)),
                    step=step,
                    initial_value=_rounded(p.value),
                    hint=_capital(p.meaning),
                )
                slider.precision = FIGURES  # by default, the field would round to the step
                slider.on_update(callback(partial(self._tune, p)))
                self._sliders[p.name] = slider
        with self._folder:
            taken = [known.name for known in self._context.session.scene.swatches]
            own = name if name.startswith("my ") else f"my {name}"
            self._name = gui.add_text("New name", numbered(own, taken))
            for label, hint, act in BUTTONS[: None if found else 1]:  # the swatch plain can only be copied
                gui.add_button(label, hint=hint).on_click(callback(partial(act, self)))

    def _clear(self, text: str = "") -> None:
        if self._folder is not None:
            self._folder.remove()
        self._folder, self._sliders, self._shown = None, {}, ()
        set_html(self._head, card_html(text))

    def _tune(self, p: Parameter, target: Control) -> None:
        value = bounded(target.value, p.minimum, p.maximum, p.value)
        numbers, tools = {p.name: value}, self._context.tools
        if p.name == "friction_dynamic" and tools.swatch is not None:  # keeps the ratio of the two coefficients
            swatch = self._context.session.scene.swatches[tools.swatch]
            ratio = swatch.friction_static / swatch.friction_dynamic if swatch.friction_dynamic > 0.0 else 1.0
            numbers["friction_static"] = ratio * value
        self._context.session.tune(tools.ensure_swatch(), **numbers)

    def _copy(self, target: Control) -> None:
        session, name = self._context.session, self._new_name()
        index = session.tuning.copy_swatch(self._context.tools.ensure_swatch(), name)
        self._context.tools.choose_swatch(name, session.scene.swatches[index])

    def _new_name(self) -> str:
        name = str(self._name.value).strip()
        if not name:
            raise SwatchError("the new swatch has no name: enter a name in the field New name")
        return name

    def _save(self, target: Control) -> None:
        name = self._new_name()
        index = self._context.tools.ensure_swatch()
        file = self._context.session.tuning.save_swatch_as(index, name)
        self._context.tools.choose_swatch(name, self._context.session.scene.swatches[index])
        self._context.say(f"Saved {name!r} to your library: {file}")


def _step(span: float) -> float:
    """A round step for a slider."""
    if span <= 0.0:
        return 1e-3
    rough = span / STEP_COUNT
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * 0.999))


def _rounded(value: float) -> float:
    """A value rounded as a field shows it."""
    return float(f"{value:.{FIGURES}g}")


BUTTONS: Final = (
    ("Copy", "Add a copy of the swatch to the scene; painted faces keep the present swatch", ParameterPanel._copy),
    ("Save as new", "Save the swatch to your library under the new name", ParameterPanel._save),
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
