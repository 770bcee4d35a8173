"""Wheels that are put together by the values of their shafts, against ratios of teeth."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.files.mechanism_reader import loads, read
from spherekit.files.mechanism_writer import dumps
from spherekit.files.toml_document import parse
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import centre_float, working_precision
from spherekit.proof.decimal_mechanism import read_decimals

GEARS = mechanism_text("gears")
OUTSIDE = {"teeth": [20, 40], "contact": "external"}
INSIDE = {"teeth": [20, 60], "contact": "internal"}


@pytest.mark.parametrize("driven", ["pinion_shaft", "wheel_shaft"])
@pytest.mark.parametrize("phase", [(0.0, 0.0), (30.0, -7.0), (300.0, 200.0)])
@pytest.mark.parametrize(
    ("links", "gears", "ratio"),
    [
        ('["base", "wheel"]', OUTSIDE, -20 / 40),
        ('["wheel", "base"]', OUTSIDE, 20 / 40),
        ('["base", "wheel"]', INSIDE, 20 / 60),
    ],
)
def test_shafts_pass_the_angles_of_their_phase_together_and_turn_at_the_ratio_of_teeth(
    driven, phase, links, gears, ratio
):
    """Shafts of wheels in mesh turn at the ratio of teeth from their stated phase.

    The expected angles obey wheel - wheel_0 = ratio (pinion - pinion_0), modulo a turn.
    `phase` has the angles pinion_0 and wheel_0 (degrees) at which the wheels are put
    together. `gears` are the numbers of teeth, with external or internal contact. `links`
    are the two links of the wheel's shaft; their order decides the sign of its angle.
    `ratio` is the signed ratio of teeth from the pinion to the wheel. `driven` is the
    input.
    """
    pinion_phase, wheel_phase = phase
    phase_line = f"phase = {{ wheel_shaft = {wheel_phase}, pinion_shaft = {pinion_phase} }}"
    mechanism = loads(GEARS.format(links=links, **gears, phase=phase_line, driven=driven))
    assert loads(dumps(mechanism)) == mechanism

    input_angles_deg = np.linspace(-200.0, 500.0, 15)
    rows = sk.trace(mechanism, path=np.radians(input_angles_deg)).values
    wheel = np.degrees(rows[:, mechanism.angles["wheel_shaft"]])
    pinion = np.degrees(rows[:, mechanism.angles["pinion_shaft"]])
    error = wheel - wheel_phase - ratio * (pinion - pinion_phase)
    if driven == "wheel_shaft":
        # The angle of the pinion is then computed, up to whole turns of the pinion.
        # Dividing by the ratio states the error as an angle of the pinion.
        error = error / ratio
    assert np.abs((error + 180.0) % 360.0 - 180.0).max() < 1e-10


def test_a_whole_turn_of_a_wheel_in_its_start_does_not_count():
    """It is 1.5 turns of the pinion; wheels are put together as they have rolled least."""
    shafts, q, ahead = np.radians(75.0), np.linspace(0.0, 9.0, 7), []
    lap = 360.0 * np.sin(np.arctan2(np.sin(shafts), 20 / 30 + np.cos(shafts)))
    for start in (50.0, 50.0 + lap, 50.0 - 2.0 * lap):
        of = OUTSIDE | {"teeth": [20, 30], "phase": f"start = [20.0, {start}]"}
        made = loads(GEARS.format(links='["base", "wheel"]', driven="wheel_shaft", **of))
        ahead.append(sk.trace(made, path=q).values[:, made.angles["pinion_shaft"]])
    assert np.abs(np.sin(0.5 * (np.array(ahead) - ahead[0]))).max() < 1e-12


def test_the_proof_knows_the_phase():
    said = "phase = { wheel_shaft = -7.0, pinion_shaft = 30.0 }"
    links = '["base", "wheel"]'
    gears = GEARS.format(links=links, **OUTSIDE, phase=said, driven="pinion_shaft")
    posed = mechanism_text("posed_geared_five_bar").format(20, 40, 0.0, 360.0)
    for text, expected in ((gears, -7.0 - 0.5 * 60.0), (posed, -31.0 - 0.5 * 69.5)):
        document = parse(text, "gears")
        with working_precision(80):
            written = read_decimals(read(document), document)
            _, wheel = written.known_angles([written.input_angle("90")])
            assert np.degrees(centre_float(wheel)) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("teeth", [(20, 40), (200, 10)])
@pytest.mark.parametrize("phase", ["30.1", "-3000.1", "360000.1"])
@pytest.mark.parametrize("driven", ["pinion_shaft", "wheel_shaft"])
def test_the_proof_encloses_the_angle_of_a_wheel_at_a_phase_of_many_turns(
    driven, phase, teeth
):
    gears = GEARS.format(
        links='["base", "wheel"]',
        teeth=[*teeth],
        contact="external",
        phase=f"phase = {{ wheel_shaft = 7.7, pinion_shaft = {phase} }}",
        driven=driven,
    )
    document = parse(gears, "gears")
    with working_precision(120):
        decimals = read_decimals(read(document), document)
        _, follower = decimals.known_angles([decimals.input_angle("10")])
        pinion_phase, wheel_phase = map(decimals.input_angle, (phase, "7.7"))
        ratio = exact_ball(teeth[0]) / teeth[1]
        q = decimals.input_angle("10")
        if driven == "pinion_shaft":
            expected = wheel_phase - ratio * (q - pinion_phase)
        else:
            expected = pinion_phase - (q - wheel_phase) / ratio
        turns = (follower - expected) / decimals.input_angle("360")
        assert turns.contains(round(centre_float(turns)))
        assert float(turns.rad()) < 1e-6


@pytest.mark.parametrize(
    ("phase", "told"),
    [
        ("{ pinion_shaft = 0.0, mesh = 0.0 }", "none of .* is an R pair of link wheel"),
        ("{ pinion_shaft = 0.0, wheel = 0.0 }", 'no pair is named "wheel"'),
        (
            "{ pinion_shaft = 0.0, wheel_shaft = 0.0 }\nstart = [0.0, 0.0]",
            "already determines",
        ),
    ],
)
def test_a_phase_is_that_of_both_shafts(phase, told):
    text = GEARS.format(
        links='["base", "wheel"]', **OUTSIDE, phase=f"phase = {phase}", driven="wheel_shaft"
    )
    with pytest.raises(sk.SpherekitError, match=rf"pairs\.mesh\.phase.*{told}"):
        loads(text)
