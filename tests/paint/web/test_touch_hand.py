"""The hand behind the page, with a servo that only takes notes, and with a real one."""

import asyncio
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from hapscene.constants import DEFAULT_GRIP, TICK_S
from hapscene.device.sim.hand import GRIPS
from hapscene.errors import HapsceneError
from hapscene.loop.servo_state import ServoState, TickLog
from hapscene.paint.model.composing import Composing
from hapscene.paint.model.painting import Painting
from hapscene.paint.web.hand import (
    ADDED_N,
    CORRECTION_1_S,
    HAND_DEVICES,
    HOVER_M,
    IDLE_S,
    LIFT_M,
    NO_HANDLE,
    REACTION_S,
    HandConfig,
    TouchHand,
    aim_point,
    compliance_m_N,
    make_servo,
)
from hapscene.scene.scene import Scene
from tests.virtual_clock import PATIENCE_S
from tests.virtual_servo import TICKS_MAX, VirtualServo

from ..conftest import plate_mesh

UP = np.array([0.0, 0.0, 1.0])
PLACE = np.array([0.01, 0.02, 0.03])


class Notes:
    """Stands in for a servo."""

    def __init__(self, hold: HandConfig, refuse: str | None = None) -> None:
        self.hold, self.refuse, self.alive, self.closed = hold, refuse, True, False
        self.orders: list[tuple[Any, ...]] = []
        self.read_from: list[int] = []
        self.tick, self.touches, self.force_N = 9, True, 2.0

    def __enter__(self) -> "Notes":
        if self.refuse:
            raise HapsceneError(self.refuse)
        return self

    def close(self) -> None:
        self.closed = True

    def start(self, p_W_m: Any, grip: str) -> None:
        self.orders.append(("start", tuple(p_W_m)))

    def aim(self, p_W_m: Any, grip: str) -> None:
        self.orders.append(("aim", tuple(p_W_m)))

    def pause(self) -> None:
        self.orders.append(("pause",))

    def tune(self, swatch: str, **numbers: float) -> None:
        if swatch == "gone":
            raise HapsceneError("no swatch named 'gone'")
        self.orders.append(("tune", swatch, numbers))

    def repaint(self, scene: Scene) -> None:
        self.orders.append(("repaint", scene))

    def state(self) -> ServoState:
        zero = np.zeros(3)
        return ServoState(self.tick, PLACE, PLACE, UP, zero, 0.0, 0.0, self.touches, 0, 0, 0, 0)  # type: ignore[arg-type]

    def read(self, since: int) -> TickLog:
        self.read_from.append(since)
        rows = np.zeros(3, [("f_W_N", "f8", (3,)), ("nhat_W", "f8", (3,))])
        rows["f_W_N"][:, 2], rows["nhat_W"] = self.force_N, UP
        return TickLog(since, rows, np.zeros((3, 10)), np.ones((3, 10)))


def run(act: Callable[[TouchHand, list[Notes], list[str]], Any], refuse: str | None = None) -> None:
    """Do something with a hand, in an event loop."""
    made: list[Notes] = []
    said: list[str] = []

    def make(scene: Scene, hold: HandConfig, progress: Callable[[str], None]) -> Notes:
        made.append(Notes(hold, refuse))
        return made[-1]

    async def main() -> None:
        touch = TouchHand(lambda text, kind: said.append(text), HandConfig(), make)
        await touch.open(Scene())
        await act(touch, made, said)
        touch.close()

    asyncio.run(main())
    assert all(notes.closed for notes in made)


async def settle(touch: TouchHand) -> None:
    """Wait until all is done that was asked for."""
    while touch._tasks:
        await asyncio.gather(*touch._tasks)


@pytest.mark.parametrize("stiffness_N_m", [100.0, 700.0])
@pytest.mark.parametrize("grip", ["light", "firm"])
def test_target_depth_gives_the_requested_force(stiffness_N_m: float, grip: str) -> None:
    """At rest the grip's pull is the wall's push: k (depth − x) = K x = force."""
    depth_m = float((PLACE - aim_point(PLACE, UP, 1.5, stiffness_N_m, grip)) @ UP)
    k = GRIPS[grip].k_N_m
    x_m = k * depth_m / (k + stiffness_N_m)
    assert stiffness_N_m * x_m == pytest.approx(1.5)


def test_hand_presses_strokes_lifts_and_stops() -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        assert touch.read(0.0) is None
        assert touch.press(PLACE, UP, 1.0, 500.0)
        await settle(touch)
        assert len(made[0].orders) == 2
        assert made[0].orders[0] == ("start", tuple(PLACE + HOVER_M * UP))
        assert made[0].orders[1] == ("aim", tuple(aim_point(PLACE, UP, 1.0, 500.0, DEFAULT_GRIP)))
        read = touch.read(0.0)
        assert read is not None and read[1] == pytest.approx([2.0] * 3)
        assert read[2].shape == (3, 10) and (read[2] == 1.0).all()  # the handle's
        assert made[0].read_from == [made[0].state().tick + 1]  # nothing of the touch before
        touch.move(PLACE + 0.001, UP, 1.0, 500.0)
        touch.lift(5.0)
        assert made[0].orders[-1] == ("aim", tuple(PLACE + LIFT_M * UP))
        assert touch.read(5.0 + 0.9 * IDLE_S) is not None
        touch.read(5.0 + 1.1 * IDLE_S)
        await settle(touch)
        assert len(made[0].orders) == 5
        assert made[0].orders[-1] == ("pause",) and touch.read(99.0) is None

    run(act)


@pytest.mark.parametrize(
    ("touches", "force_N", "missing_N"), [(True, 2.0, -1.0), (True, 0.5, 0.5), (True, 0.97, 0.0), (False, 0.0, 1.0)]
)
def test_force_is_corrected_once_the_hand_has_reacted(touches: bool, force_N: float, missing_N: float) -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        touch.press(PLACE, UP, 1.0, 500.0)
        await settle(touch)
        notes, aim = made[0], aim_point(PLACE, UP, 1.0, 500.0, DEFAULT_GRIP)
        notes.touches, notes.force_N = touches, force_N
        touch.read(0.0)  # the contact begins, or continues
        notes.tick = touch._surface_tick + round(REACTION_S / TICK_S)
        touch.read(0.0)
        await settle(touch)
        assert [order[0] for order in notes.orders] == ["start", "aim"]
        notes.tick += 1
        touch.read(0.0)
        await settle(touch)
        deeper_m = CORRECTION_1_S * 3 * TICK_S * missing_N * compliance_m_N(500.0, DEFAULT_GRIP)
        assert notes.orders[-1][1] == pytest.approx(tuple(aim - deeper_m * UP), abs=1e-12)
        for _ in range(200):  # up to the limit of the correction
            touch.read(0.0)
        await settle(touch)
        most_N = {-1.0: -1.0, 0.5: 1.0, 0.0: 0.0, 1.0: ADDED_N}[missing_N]
        deeper_m = most_N * compliance_m_N(500.0, DEFAULT_GRIP)
        assert notes.orders[-1][1] == pytest.approx(tuple(aim - deeper_m * UP), abs=1e-12)

    run(act)


def test_numbers_that_wait_become_one_order() -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        for value in range(50):
            touch.tune("wood", {"stiffness_N_m": float(value)})
        await settle(touch)
        assert made[0].orders[-1] == ("tune", "wood", {"stiffness_N_m": 49.0})
        assert len(made[0].orders) <= 2

    run(act)


def test_last_selected_device_is_opened_with_the_latest_painting() -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        scene = Scene()
        touch.repaint(scene)
        orders = []
        for device in HAND_DEVICES:
            touch.config = HandConfig(device)
            orders.append(asyncio.ensure_future(touch.open(Scene())))
            await asyncio.sleep(0.0)
        await asyncio.gather(*orders)
        assert touch.status == "ready" and made[-1].hold.device == list(HAND_DEVICES)[-1]
        assert all(notes.closed for notes in made[:-1])
        await settle(touch)
        assert any(("repaint", scene) in notes.orders for notes in made)

    run(act)


def test_refused_order_does_not_block_later_orders() -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        touch.tune("gone", {"stiffness_N_m": 1.0})
        touch.tune("wood", {"stiffness_N_m": 300.0})
        await settle(touch)
        assert made[0].orders == [("tune", "wood", {"stiffness_N_m": 300.0})] and "gone" in said[0]

    run(act)


def test_after_a_start_that_the_system_refused_another_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Notes) -> Notes:
        raise OSError(28, "No space left on device")

    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        with monkeypatch.context() as then:
            then.setattr(Notes, "__enter__", full)
            await touch.open(Scene())
        assert touch.status == "failed" and "No space left" in said[-1]
        await touch.open(Scene())
        assert touch.status == "ready" and touch.press(PLACE, UP, 1.0, 500.0)

    run(act)


@pytest.mark.parametrize(("device", "ends"), [("omni", True), ("omni-point", False)])
def test_a_stroke_beyond_the_arms_reach_is_said_once_and_stays_where_it_is(device: str, ends: bool) -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        touch.config = HandConfig(device)
        touch.press(PLACE, UP, 1.0, 500.0)
        await settle(touch)
        assert len(made[0].orders) == 2
        touch.move(np.add(PLACE, (0.05, 0.0, 0.0)), UP, 1.0, 500.0)
        assert len(made[0].orders) == 3 and not said
        for x_m in (0.4, 0.5):
            touch.move(np.add(PLACE, (x_m, 0.0, 0.0)), UP, 1.0, 500.0)
        assert len(made[0].orders) == (3 if ends else 5)
        assert len(said) == ends and all("choose omni-point" in line for line in said)
        touch.lift(0.0)
        touch.press(np.add(PLACE, (0.5, 0.0, 0.0)), UP, 1.0, 500.0)  # the arm is placed anew
        await settle(touch)
        assert made[0].orders[-1][1][0] == PLACE[0] + 0.5 and len(said) == ends

    run(act)


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize("first", ["move", "lift", "read"])
def test_dead_servo_process_is_reported_once(first: str, is_known: bool) -> None:
    async def act(touch: TouchHand, made: list[Notes], said: list[str]) -> None:
        def die(*arguments: object) -> None:
            made[0].alive = False
            raise HapsceneError("its process has ended")

        touch.press(PLACE, UP, 1.0, 500.0)
        await settle(touch)
        assert len(made[0].orders) == 2
        made[0].alive = not is_known  # else the next order finds out
        for order in ("aim", "state", "read"):
            setattr(made[0], order, die)
        asks: dict[str, Callable[[], Any]] = {
            "move": lambda: touch.move(PLACE, UP, 1.0, 500.0),
            "lift": lambda: touch.lift(0.0),
            "read": lambda: touch.read(0.0),
        }
        for ask in (asks[first], *asks.values()):
            assert ask() is None
        assert touch.status == "failed" and len(said) == 1
        assert not touch.press(PLACE, UP, 1.0, 500.0)

    run(act)


async def feel(hold: HandConfig, force_N: float) -> tuple[TickLog, list[str]]:
    """Press with a real servo on the side of a plate until the force has been right for 0.3 s, then stroke 0.3 s."""
    scene, said = Scene(), list[str]()
    scene.add(plate_mesh(0.01, cells=1), name="plate", swatch="wood")
    place, nhat, stiffness = np.array([0.02, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), scene.swatches[1].stiffness_N_m
    touch = TouchHand(lambda text, kind: said.append(text), hold, partial(make_servo, servo=VirtualServo))
    try:
        await touch.open(scene)
        assert touch.press(place, nhat, force_N, stiffness)
        right, newest = 0, 0
        while right < 300 or newest < 1000:
            assert newest < TICKS_MAX and not said, "the requested force was not reached"
            await settle(touch)
            touch.servo.advance(25)
            if (read := touch.read(touch.servo.clock.now_s())) is not None:
                right = right + len(read[1]) if (abs(read[1] - force_N) < 0.1 * force_N).all() else 0
                newest = read[0].tick
        while touch.servo.state().tick < newest + 300:
            touch.move(np.add(place, (0.0, 5e-5 * (touch.servo.state().tick - newest), 0.0)), nhat, force_N, stiffness)
            touch.servo.advance(10)
        return touch.servo.read(newest), said
    finally:
        touch.close()


def test_omni_press_reaches_the_requested_force_and_the_handle_plays() -> None:
    """Without force feedback, friction (0.26 N) and flexibility of the arm would take a quarter of the force."""
    felt, said = asyncio.run(feel(HandConfig("omni", "light", "naive"), 1.0))
    assert not said and np.isfinite(felt.a_handle_m_s2).all()
    assert felt.a_m_s2.std() > 0.05 and felt.a_handle_m_s2.std() > 0.05
    assert (felt.a_handle_m_s2 - felt.a_m_s2).std() > 0.2 * felt.a_m_s2.std()


def test_hand_with_a_round_tip_keeps_its_centre_a_radius_above_the_surface() -> None:
    felt, said = asyncio.run(feel(HandConfig("omni-point", "medium", NO_HANDLE, tip_radius_m=0.004), 1.0))
    assert not said and felt.rows["touching"].all()
    assert felt.rows["p_WP_m"][:, 0] == pytest.approx(0.024, abs=3e-6)
    assert felt.rows["p_WC_m"][:, 0] == pytest.approx(0.02, abs=3e-6)


@pytest.mark.parametrize(
    ("grip", "force_N", "peak_N"), [("medium", 0.5, 1.0), ("medium", 1.0, 1.8), ("light", 0.2, 0.6)]
)
def test_press_reaches_the_surface_without_a_force_peak(grip: str, force_N: float, peak_N: float) -> None:
    """A press below the friction of the arm (0.26 N) must increase until the arm moves."""

    async def land() -> np.ndarray:
        scene = Scene()
        scene.add(plate_mesh(0.01, cells=1), name="plate", swatch="wood")
        place, nhat = np.array([0.0, 0.0, 0.005]), np.array([0.0, 0.0, 1.0])
        make = partial(make_servo, servo=VirtualServo)
        touch = TouchHand(lambda text, kind: None, HandConfig("omni", grip, NO_HANDLE), make)
        try:
            await touch.open(scene)
            touch.press(place, nhat, force_N, scene.swatches[1].stiffness_N_m)
            felt_N = np.zeros(0)
            while np.count_nonzero(felt_N) < 500:
                assert len(felt_N) < TICKS_MAX, "no contact"
                await settle(touch)
                touch.servo.advance(15)
                if (read := touch.read(touch.servo.clock.now_s())) is not None:
                    felt_N = np.append(felt_N, read[1])
            return felt_N
        finally:
            touch.close()

    assert force_N / 2 < asyncio.run(land()).max() < peak_N


def test_a_page_that_closes_does_not_wait_for_a_hand_that_starts() -> None:
    """A first start compiles, which may take half a minute."""

    class Slow(Notes):
        begun, given_up = threading.Event(), threading.Event()

        def __enter__(self) -> "Slow":
            self.begun.set()
            assert self.given_up.wait(PATIENCE_S)
            raise HapsceneError("given up")

        def cancel(self) -> None:
            self.given_up.set()

    made: list[Slow] = []

    def make(scene: Scene, hold: HandConfig, progress: Callable[[str], None]) -> Slow:
        made.append(Slow(hold))
        return made[-1]

    async def main() -> None:
        touch = TouchHand(lambda text, kind: None, HandConfig(), make)
        opening = asyncio.create_task(touch.open(Scene()))
        assert await asyncio.to_thread(Slow.begun.wait, PATIENCE_S)
        opening.cancel()
        touch.close()

    asyncio.run(main())
    assert made[0].closed


def test_bodies_that_come_move_and_go_are_felt_where_they_are() -> None:
    """A plate is moved to the hand, another comes, grows, and the first one goes."""

    async def touched(touch: TouchHand, place: np.ndarray) -> str:
        touch.press(place, np.array([0.0, 0.0, 1.0]), 1.0, 500.0)
        for _ in range(TICKS_MAX // 20):
            await settle(touch)
            touch.servo.advance(20)
            read = touch.read(touch.servo.clock.now_s())
            if read is not None and read[0].touching and np.linalg.norm(read[0].p_WP_m - place) < 0.002:
                touch.lift(touch.servo.clock.now_s())
                return str(touch.servo.body_names[read[0].body])
        raise AssertionError("nothing is felt there")

    async def act() -> None:
        said: list[str] = []
        painting = Painting(one_plate())
        composing = Composing(painting)
        config, make = HandConfig("omni-point", "medium", NO_HANDLE), partial(make_servo, servo=VirtualServo)
        touch = TouchHand(lambda text, kind: said.append(text), config, make)
        try:
            await touch.open(painting.snapshot())
            X_WB = np.eye(4)
            X_WB[:3, 3] = (0.0, 0.0, 0.1)
            composing.move("plate", X_WB)
            touch.repaint(painting.snapshot())
            assert await touched(touch, np.array([0.0, 0.0, 0.105])) == "plate"
            X_WB[:3, 3] = (0.3, 0.0, 0.0)
            composing.move("plate", X_WB)
            (other,) = composing.add(one_plate())
            touch.repaint(painting.snapshot())
            assert await touched(touch, np.array([0.0, 0.0, 0.005])) == other == "plate 2"
            composing.scale(other, 2.0)
            composing.delete("plate")
            touch.repaint(painting.snapshot())
            assert await touched(touch, np.array([0.035, 0.0, 0.01])) == other
            composing.scale(other, 20.0)  # too large to be added: the hand starts anew
            touch.repaint(painting.snapshot())
            await settle(touch)
            assert await touched(touch, np.array([0.3, 0.1, 0.2])) == other
            assert not said
        finally:
            touch.close()

    asyncio.run(act())


def one_plate() -> Scene:
    scene = Scene()
    scene.add(plate_mesh(0.01, cells=1), name="plate", swatch="wood")
    return scene
