"""The options that say how a texture is fitted: the order of its models, how they blend, what drives them."""

import argparse
from typing import Any, Final, Literal

from hapscene.command.word import whole
from hapscene.constants import ORDER_MAX

INTERPOLATIONS: Final = ("lsf", "reflection", "direct", "hatt")  # as in surface.blend, which is heavy to import
EXCITATIONS: Final = ("auto", "gaussian", "measured")  # as in capture.swatch_fit


def add_fit_options(command: argparse.ArgumentParser) -> None:
    """Adds --order, --interpolation and --excitation."""
    command.add_argument(
        "--order", type=_order, default="auto", metavar="N",
        help="of the texture's models (default: auto, held-out data)",
    )  # fmt: skip
    command.add_argument(
        "--interpolation", choices=INTERPOLATIONS, default="lsf", help="how the texture blends its models (default lsf)"
    )
    command.add_argument(
        "--excitation", choices=EXCITATIONS, default="auto",
        help="the noise that drives the texture (default: auto, the nearer one on held-out data)",
    )  # fmt: skip


def fit_options(options: argparse.Namespace) -> dict[str, Any]:
    """What `fit_parts` takes of them."""
    return {"order": options.order, "interpolation": options.interpolation, "excitation": options.excitation}


def _order(text: str) -> int | Literal["auto"]:
    if text == "auto":
        return "auto"
    return whole('an order is "auto", or', 1, ORDER_MAX)(text)
