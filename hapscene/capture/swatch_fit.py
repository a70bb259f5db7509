"""A swatch from a recording of a tool on a surface: the main entry of `hapscene.capture`."""

from typing import Literal

from numpy.typing import ArrayLike

from hapscene.capture.channel import clean
from hapscene.capture.friction import fit_friction
from hapscene.capture.order import search_order
from hapscene.capture.texture_fit import choose_model_count, cut, fit_texture
from hapscene.constants import ORDER_MAX
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch


def fit(
    acceleration_m_s2: ArrayLike,
    rate_Hz: float,
    force_N: ArrayLike | None = None,
    speed_m_s: ArrayLike | None = None,
    tangential_force_N: ArrayLike | None = None,
    name: str = "unnamed",
    order: int | Literal["auto"] = "auto",
    model_count: int | Literal["auto"] = "auto",
) -> Swatch:
    """The swatch of a recording of a tool that slides over a surface.

    Args:
        acceleration_m_s2: (n,) acceleration of the tool, one axis.
        rate_Hz: sample rate of all streams; the models are made for it.
        force_N: (n,) normal force, one number, or None: then 1 N is assumed.
        speed_m_s: (n,) slip speed, one number, or None: then 0.1 m/s is assumed.
        tangential_force_N: (n,) tangential force, or None: then the swatch has no friction.
        name: of the swatch.
        order: of the AR models, or "auto": chosen on held-out data (`hapscene.capture.order`).
        model_count: models over force and speed, or "auto": as many as hold on held-out data.

    Returns:
        A swatch with texture and, with tangential force, friction. Stiffness and taps are not in such a recording:
        the stiffness is the default, taps are None.

    Raises:
        CaptureError: from such streams nothing can be fitted; the text says why.
    """
    channels = clean(acceleration_m_s2, rate_Hz, force_N, speed_m_s, tangential_force_N)
    pieces = cut(channels)
    if order == "auto":
        order = search_order(channels.acceleration_m_s2, channels.rate_Hz).chosen
    elif type(order) is not int or not 1 <= order <= min(ORDER_MAX, pieces.acceleration_m_s2.shape[1] // 2):
        raise CaptureError(f'order must be "auto" or a whole number from 1 to {ORDER_MAX}, is {order!r}')
    if model_count == "auto":
        model_count = choose_model_count(pieces, channels.rate_Hz, order)
    elif type(model_count) is not int or not 1 <= model_count <= len(pieces):
        raise CaptureError(f'model_count must be "auto" or a whole number from 1 to {len(pieces)}, is {model_count!r}')
    static = dynamic = 0.0
    if channels.tangential_force_N is not None:
        static, dynamic = fit_friction(channels.tangential_force_N, channels.force_N, channels.speed_m_s)
    texture = fit_texture(pieces, channels.rate_Hz, order, model_count)
    return Swatch(name, friction_static=static, friction_dynamic=dynamic, texture=texture)
