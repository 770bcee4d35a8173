"""What public functions are given wrongly: refused with a typed error that says what."""

import inspect
from enum import IntEnum
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import spherekit as sk
import spherekit.engine as sk_engine
import spherekit.view as sk_view
from spherekit.argument_validation import _fits, _resolved, checked
from spherekit.engine import kernel
from spherekit.errors import SpherekitError
from spherekit.model.load import Load

FOUR_BAR, FIVE_BAR = sk.load("four_bar"), sk.load("five_bar")
START, LAW = sk.Start(0.3, 1.0), sk.ConstantSpeed(1.0)


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ({"analysis": "polez"}, 'did you mean "poles"'),
        ({"analysis": 5}, "analysis is 5"),
        ({"table": "x"}, 'no table "x"'),
        ({"degrees": "deg"}, "True or False"),
    ],
)
def test_wrong_questions_to_a_result(named, said, tmp_path):
    result = sk.run(FOUR_BAR, samples=3)
    with pytest.raises(SpherekitError, match=said):
        result.frame(**named)
    for formats in ("csv", ("xls",)):
        with pytest.raises(SpherekitError, match="formats"):
            result.write(tmp_path / "out", formats=formats)
    assert list(tmp_path.iterdir()) == []


COMPUTED = (
    *("Kernel", "Kinematics", "Mechanism", "Motion"),
    *("Plan", "RunResult", "Simulation"),
)
"""Public classes whose objects functions of ours make."""
INSIDE = {
    "Bearings": "carried",
    "Digits": "within",
    "Mechanism": "angle_between names_of variables_of",
    "Motion": "joined put rows",
    "Plan": "name pole",
    "InverseKinematics": "no_closed_form",
    "Study": "fault",
    "TorqueTable": "knots one",
}
"""Methods by which parts of the library ask each other, as do all of `Load`."""
MADE = {
    "Bearings": sk.Bearings("b", "21", (1.0,)),
    "ConstantSpeed": LAW,
    "Cycloidal": sk.Cycloidal(0.0, 1.0, 1.0),
    "Digits": sk.Digits(30),
    "ForwardKinematics": sk.ForwardKinematics(FIVE_BAR),
    "InverseKinematics": sk.InverseKinematics(FIVE_BAR),
    "Mechanism": FOUR_BAR,
    "Polynomial": sk.Polynomial((1.0, 2.0)),
    "Start": START,
    "Tabulated": sk.Tabulated((0.0, 1.0), (0.0, 1.0), True),
    "TorqueTable": sk.TorqueTable("t", "21", (0.0, 1.0), (0.0, 1.0)),
}


def computed():
    """One object of each class of `COMPUTED`."""
    return {
        "Kernel": kernel(FOUR_BAR, "21", engine="numpy"),
        "Kinematics": sk.evaluate(FOUR_BAR, 0.3),
        "Mechanism": FOUR_BAR,
        "Motion": sk.trace(FOUR_BAR, samples=3),
        "Plan": sk.plan(FOUR_BAR),
        "RunResult": sk.run(FOUR_BAR, "poles", samples=3),
        "Simulation": sk.simulate(FOUR_BAR, START, 0.1, engine="numpy"),
    }


def public_callables():
    """Every public function, class and method that takes arguments, by its name."""
    objects = MADE | computed()
    for package in (sk, sk_engine, sk_view):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isclass(value) and not issubclass(value, Exception | IntEnum):
                if name not in COMPUTED:
                    yield name, value
                left_out = {*INSIDE.get(name, "").split(), *dir(Load)}
                for key, item in inspect.getmembers(value, inspect.isfunction):
                    if key not in left_out and (key[0] != "_" or key == "__call__"):
                        asked = len(inspect.signature(item).parameters) > 1
                        if asked and name in objects:
                            yield f"{name}.{key}", getattr(objects[name], key)
            elif callable(value) and not inspect.isclass(value):
                yield name, value


def of_kind(parameter, function, objects):
    """Return something that a parameter's type allows, if there is such a thing here."""
    asked = function.__init__ if inspect.isclass(function) else function
    hint = _resolved(getattr(asked, "__func__", asked), parameter.annotation)
    return next((value for value in objects if _fits(value, hint)), object())


def test_every_public_callable_is_checked():
    """Each refuses an object of no known type in each of its arguments."""
    allowed = [
        *computed().values(),
        *MADE.values(),
        *(1, 1.0, "x", "rad", np.eye(3), print, sk.sweep),
        *((1, 1), (1.0, 0.0, 0.0), ("1", "0", "0"), ["x"], [1.0], [LAW]),
        *({"x": 1.0}, {"x": "x"}, {"x": LAW}, {"x": ["1", "2"]}),
    ]
    asked, missed = 0, []
    for name, function in public_callables():
        parameters = inspect.signature(function).parameters.values()
        asked_for = [p for p in parameters if p.annotation not in (p.empty, Any, "Any")]
        for wrong in asked_for:
            if wrong.kind in (wrong.VAR_POSITIONAL, wrong.VAR_KEYWORD):
                continue
            others = [p for p in asked_for if p is not wrong and p.default is p.empty]
            given = {p.name: of_kind(p, function, allowed) for p in others}
            asked += 1
            try:
                function(**given, **{wrong.name: object()})
            except SpherekitError as error:
                unlike = [key for key, value in given.items() if type(value) is object]
                if any(key in str(error) for key in (wrong.name, *unlike)):
                    continue
            except Exception as error:
                missed.append(f"{name}: {wrong.name}: {error!r}")
                continue
            missed.append(f"{name}: {wrong.name} may be anything")
    assert not missed, "\n".join(missed)
    assert asked > 200


def test_what_the_types_allow_passes():
    """NumPy's numbers, lists for sequences, paths for text: nothing right is refused."""

    @checked(SpherekitError)
    def asked(
        count: int,
        size: float = 1.0,
        flag: bool = False,
        words: "tuple[str, ...] | None" = None,
        late: "NoSuchType | None" = None,  # noqa: F821
        numbers: ArrayLike | None = None,
    ) -> int:
        return count

    assert asked(np.int64(3), np.float32(2), np.bool_(True), ["a", "b"], object()) == 3
    assert asked(count=3, size=2) == 3
    for numbers in (1, 0.5, [1, 2], [[1.0], [2.0]], np.eye(3), None):
        assert asked(3, numbers=numbers) == 3
    for wrong in (
        {"count": 3.0},
        {"count": True},
        {"count": 3, "size": "2"},
        {"count": 3, "numbers": "a"},
    ):
        with pytest.raises(SpherekitError):
            asked(**wrong)
    with pytest.raises(SpherekitError, match="asked: missing a required argument: 'count'"):
        asked()
    with pytest.raises(SpherekitError, match=r'asked: no argument is "cnt"; did you mean'):
        asked(cnt=3)


def test_too_many_arguments_are_told_beside_a_correct_option():
    with pytest.raises(SpherekitError, match="run: too many positional arguments"):
        sk.run(FOUR_BAR, "poles", "statics", samples=3)
