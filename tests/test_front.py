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
from spherekit.checked import _fits, _resolved, checked
from spherekit.dynamics.forward import simulate
from spherekit.dynamics.inverse import inverse_dynamics
from spherekit.dynamics.tabulate import online_model
from spherekit.engine import kernel
from spherekit.errors import SpherekitError
from spherekit.exchange.mjcf import mjcf
from spherekit.model.load import Load
from spherekit.model.study import ConstantSpeed, Cycloidal, Start, Tabulated
from spherekit.motion.motion import Tracer
from spherekit.tradeoff.trade import trade

NAN = float("nan")
FOUR_BAR, FIVE_BAR = sk.load("four_bar"), sk.load("five_bar")
START, LAW = Start(0.3, 1.0), ConstantSpeed(1.0)
FILE = "a file"

WRONG = [
    (sk.run, (FOUR_BAR,), {"engine": "cuda"}, '"cuda" is not known; allowed: "auto"'),
    (sk.run, (FOUR_BAR,), {"engine": "numpi"}, 'did you mean "numpy"'),
    (sk.run, (FOUR_BAR,), {"engine": "compiled"}, "without a simulation"),
    (sk.run, (FOUR_BAR,), {"formats": "csv"}, "formats is 'csv' .str., .* a sequence"),
    (sk.run, (FOUR_BAR,), {"formats": ["csv", "xls"]}, "one of csv, parquet"),
    (sk.run, (FOUR_BAR,), {"samples": "many"}, "samples is 'many'"),
    (sk.run, (FOUR_BAR,), {"samples": 0}, "sample"),
    (sk.run, (FOUR_BAR,), {"samples": 3.0}, "a whole number"),
    (sk.run, (FOUR_BAR,), {"samples": True}, "a whole number"),
    (sk.run, (FIVE_BAR,), {"samples": [3, 0]}, "sample"),
    (sk.run, (FOUR_BAR,), {"assembly_mode": 0.5}, "assembly_mode is 0.5"),
    (sk.run, (FOUR_BAR,), {"assembly_mode": 9}, "no assembly mode 9"),
    (sk.run, (5,), {}, "subject is 5"),
    (sk.run, ("four_bra",), {}, "four_bra"),
    (sk.run, (FOUR_BAR,), {"sampels": 9}, 'no option "sampels"; did you mean "samples"'),
    (sk.run, (FOUR_BAR, 5), {}, "analyses is 5"),
    (sk.run, (FOUR_BAR, "polez"), {}, 'did you mean "poles"'),
    (sk.run, (FOUR_BAR,), {"input_pair": "99"}, 'no pair is named "99"'),
    (sk.run, (FOUR_BAR,), {"input_pair": []}, "names no pair"),
    (sk.run, (FOUR_BAR,), {"path": "ab"}, "it has to be numbers"),
    (sk.run, (FOUR_BAR,), {"path": np.array([["a"]])}, "it has to be numbers"),
    (sk.run, (FOUR_BAR,), {"path": np.array([[1j]])}, "it has to be numbers"),
    (sk.run, (FOUR_BAR,), {"path": np.array([[NAN]])}, "finite"),
    (sk.run, (FOUR_BAR,), {"path": np.zeros((3, 2))}, "path"),
    (sk.run, (FOUR_BAR,), {"grid": "no"}, "True or False"),
    (sk.run, (FOUR_BAR,), {"laws": LAW, "duration": 1.0}, "a mapping of text to"),
    (sk.run, (FOUR_BAR,), {"laws": {"99": LAW}, "duration": 1.0}, "99"),
    (sk.run, (FOUR_BAR,), {"duration": -1.0}, "duration"),
    (sk.run, (FOUR_BAR,), {"duration": NAN}, "duration"),
    (sk.run, (FOUR_BAR,), {"start": 1.0, "duration": 1.0}, "it has to be Start"),
    (sk.run, (FOUR_BAR,), {"start": START, "duration": 1.0, "torque": [5]}, "torque is .5"),
    (
        sk.run,
        (FOUR_BAR,),
        {"start": START, "duration": 1.0, "torque": NAN},
        "nan is not fin",
    ),
    (
        sk.run,
        (FOUR_BAR,),
        {"start": START, "duration": 1.0, "tolerance": NAN},
        "tolerance is nan",
    ),
    (sk.run, (FOUR_BAR,), {"folder": 5}, "folder is 5 .int., it has to be text or a path"),
    (sk.run, (FOUR_BAR,), {"unfinished": "go"}, 'allowed: "refuse", "resume", "discard"'),
    (sk.run, (FOUR_BAR,), {"unfinished": "resume"}, "without a folder"),
    (sk.run, (FOUR_BAR,), {"degrees": "yes"}, "True or False"),
    (sk.run, (FOUR_BAR,), {"block": 0}, "block must be at least 1, not 0"),
    (sk.run, (FOUR_BAR,), {"verify": -1}, "verify must be at least 1, not -1"),
    (sk.run, (FOUR_BAR,), {"log_every": 0}, "log_every must be at least 1, not 0"),
    (sk.run, (FOUR_BAR,), {"progress": 5}, "progress is 5"),
    (sk.run, (FOUR_BAR,), {"recorder": 3}, "recorder is 3"),
    (sk.run, (FOUR_BAR,), {"setting": "fast"}, "it has to be Setting"),
    (sk.run, ("stephenson_output",), {"engine": "cuda"}, 'allowed: "auto"'),
    (sk.trace, (FOUR_BAR,), {"samples": 1.5}, "a whole number"),
    (sk.trace, (5,), {}, "it has to be Mechanism"),
    (Tracer, (FOUR_BAR,), {"assembly_mode": 1.0}, "assembly_mode is 1.0"),
    (simulate, (FOUR_BAR, START, -1.0), {}, "-1"),
    (simulate, (FOUR_BAR, START, NAN), {}, "nan"),
    (simulate, (FOUR_BAR, START, np.inf), {}, "inf"),
    (simulate, (FOUR_BAR, (0.3, 1.0), 1.0), {}, "start is"),
    (simulate, (FOUR_BAR, START, 0.1), {"engine": "cuda"}, "is not known"),
    (simulate, (FOUR_BAR, START, 0.1), {"scheme": "euler"}, 'allowed: "series", "paper"'),
    (simulate, (FOUR_BAR, START, 0.1), {"step": 0.01}, 'without scheme = "paper"'),
    (simulate, (FOUR_BAR, START, 0.1), {"switches": "abc"}, "switches is 'abc'"),
    (simulate, (FOUR_BAR, START, 0.1), {"assembly_mode": 7}, "assembly mode"),
    (Start, ("a", 1.0), {}, "Start: q is 'a' .str., it has to be a number"),
    (ConstantSpeed, ("1",), {}, "ConstantSpeed: speed is '1'"),
    (Cycloidal, (0.0, 1.0, -1.0), {}, "duration"),
    (Tabulated, ((0.0, 1.0), ("a", 2.0), True), {}, "Tabulated: angles is"),
    (inverse_dynamics, (FOUR_BAR, "x", [0.0]), {}, "law is 'x'"),
    (inverse_dynamics, (FOUR_BAR, LAW, "abc"), {}, "it has to be numbers"),
    (inverse_dynamics, (FOUR_BAR, LAW, [[0.0]]), {}, "must be finite and increase"),
    (online_model, (FOUR_BAR,), {"poles": "3/1"}, "a sequence, each text"),
    (online_model, (FOUR_BAR,), {"poles": ["9/1"]}, "is not a pole"),
    (online_model, (FOUR_BAR,), {"tolerance": -1.0}, "tolerance"),
    (mjcf, (FOUR_BAR, np.zeros(2)), {}, "has 4 finite variables"),
    (mjcf, (FOUR_BAR, np.zeros(4)), {"timestep": 0.0}, "above 0"),
    (trade, (FOUR_BAR, 5), {}, "analysis is 5"),
    (trade, (FOUR_BAR,), {"tolerance": 1.0}, 'trade: there is no option "tolerance"'),
    (trade, (FOUR_BAR,), {"settings": ["fast"]}, "each Setting"),
    (sk.plan, (FOUR_BAR, "3/1"), {}, "poles is '3/1'"),
    (sk.plan, (FOUR_BAR, ["9/9"]), {}, "is not a pole"),
    (sk.plan, (FOUR_BAR, [(1, 99)]), {}, "numbered from 0 to 3"),
    (sk.plan, (FOUR_BAR, [(-1, 0)]), {}, "numbered from 0 to 3"),
    (sk.table, (FOUR_BAR,), {}, "it has to be Plan"),
    (sk.load, (5,), {}, "text or a path"),
    (sk.load, ("",), {}, "name a file"),
    (sk.load_study, (None,), {}, "text or a path"),
    (sk.dump, (5, FILE), {}, "it has to be Mechanism"),
    (sk.dump, (FOUR_BAR, FILE, "grad"), {}, 'allowed: "deg", "rad"'),
    (sk.mid_plane_form, (5,), {}, "it has to be Mechanism"),
    (sk.follow_rotation, (FIVE_BAR, np.zeros(5), [0, 0, 1], NAN), {}, "angle|nan"),
    (sk.follow_to, (FIVE_BAR, "a", np.eye(3)), {}, "values is 'a'"),
    (sk.quickest, (5,), {}, "rotation is 5"),
    (sk.InverseKinematics, (5,), {}, "InverseKinematics: mechanism is 5"),
    (sk.InverseKinematics, (FIVE_BAR, "nosuch"), {}, "nosuch"),
    (sk.ForwardKinematics, (5,), {}, "it has to be Mechanism"),
    (sk.ForwardKinematics(FIVE_BAR).solutions, ("a",), {}, "inputs is 'a'"),
    (sk.InverseKinematics(FIVE_BAR).solutions, ("a",), {}, "poses is 'a'"),
    (FOUR_BAR.pair, (5,), {}, 'no pair is named "5"|name is 5 .int., it has'),
    (FOUR_BAR.with_inputs, (5,), {}, "pairs is 5 .int., it has to be text"),
]


@pytest.mark.parametrize(
    ("function", "positional", "named", "said"),
    WRONG,
    ids=[
        f"{case[0].__qualname__}-{'-'.join(case[2]) or 'positional'}-{number}"
        for number, case in enumerate(WRONG)
    ],
)
def test_wrong_arguments_are_told(function, positional, named, said, tmp_path):
    positional = [tmp_path / "m.toml" if each is FILE else each for each in positional]
    with pytest.raises(SpherekitError, match=said):
        function(*positional, **named)
    assert list(tmp_path.iterdir()) == []


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
    "Mechanism": "angle_between variables_of",
    "Motion": "joined rows",
    "Plan": "name pole",
    "InverseKinematics": "no_closed_form",
    "Study": "fault",
    "TorqueTable": "knots one",
}
"""Methods by which parts of the library ask each other, as do all of `Load`."""
MADE = {
    "Bearings": sk.Bearings("b", "21", (1.0,)),
    "ConstantSpeed": LAW,
    "Cycloidal": Cycloidal(0.0, 1.0, 1.0),
    "Digits": sk.Digits(30),
    "ForwardKinematics": sk.ForwardKinematics(FIVE_BAR),
    "InverseKinematics": sk.InverseKinematics(FIVE_BAR),
    "Mechanism": FOUR_BAR,
    "Polynomial": sk.Polynomial((1.0, 2.0)),
    "Start": START,
    "Tabulated": Tabulated((0.0, 1.0), (0.0, 1.0), True),
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
