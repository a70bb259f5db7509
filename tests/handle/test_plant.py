import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapscene.errors import HandleError
from hapscene.handle import Plant

PLANTS = st.builds(
    Plant,
    m_c_kg=st.floats(0.002, 0.1),
    k_s_N_m=st.floats(20.0, 2000.0),
    b_s_Ns_m=st.floats(0.0, 3.0),
    m_h_kg=st.floats(0.02, 0.5),
    k_u_N_m=st.floats(1.0, 5000.0),
    b_u_Ns_m=st.floats(0.0, 50.0),
)


@given(PLANTS)
def test_limits_of_the_response(plant: Plant) -> None:
    high, low = plant.response(1e6), plant.response(1e-3)
    assert abs(high) == pytest.approx(1.0 / plant.m_h_kg, rel=1e-4)
    s = 2e-3 * np.pi
    assert abs(low) == pytest.approx(plant.m_c_kg * s**4 / (plant.k_s_N_m * plant.k_u_N_m), rel=1e-3)
    assert plant.travel_response(1e-6) == pytest.approx(-1.0 / plant.k_s_N_m, rel=1e-3)


@given(PLANTS, st.floats(0.1, 2000.0))
def test_the_two_mass_equations_give_equation_8(plant: Plant, frequency_Hz: float) -> None:
    """Solve the two equations of motion at one frequency, as written, not the formula."""
    s = 2j * np.pi * frequency_Hz
    z, u = plant.b_s_Ns_m * s + plant.k_s_N_m, plant.b_u_Ns_m * s + plant.k_u_N_m
    equations = np.array([[plant.m_c_kg * s**2 + z, -z], [-z, plant.m_h_kg * s**2 + z + u]])
    x_c, x_h = np.linalg.solve(equations, [-1.0, 1.0])
    assert plant.response(frequency_Hz) == pytest.approx(s**2 * x_h, rel=1e-6)
    assert plant.travel_response(frequency_Hz) == pytest.approx(x_c - x_h, rel=1e-6)


@given(PLANTS, st.floats(1.0, 1000.0))
def test_the_state_space_is_the_same_system(plant: Plant, frequency_Hz: float) -> None:
    a, b, c, d = plant.state_space()
    s = 2j * np.pi * frequency_Hz
    got = (c @ np.linalg.solve(s * np.eye(4) - a, b) + d).ravel()
    assert got[0] == pytest.approx(complex(plant.response(frequency_Hz)), rel=1e-6)
    assert got[1] == pytest.approx(complex(plant.travel_response(frequency_Hz)), rel=1e-6)
    assert got[2] * s**2 == pytest.approx(got[0], rel=1e-6)


@pytest.mark.parametrize(
    "wrong", [{"m_h_kg": 0.0}, {"m_c_kg": -1.0}, {"k_u_N_m": float("nan")}, {"travel_limit_m": float("inf")}]
)
def test_values_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(HandleError, match=next(iter(wrong))):
        Plant(**wrong)


@pytest.mark.parametrize("number", ["heavy", None, 1e300, [1.0, 2.0]])
def test_invalid_numbers_are_refused(number: object) -> None:
    with pytest.raises(HandleError, match="k_u_N_m"):
        Plant(k_u_N_m=number)  # type: ignore[arg-type]
