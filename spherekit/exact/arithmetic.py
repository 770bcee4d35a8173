"""The numbers that reference values are computed in: wide hardware floats, or mpmath's.

Both are NumPy arrays, so that the same code runs on either.
"""

from abc import ABC, abstractmethod
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked_class
from spherekit.errors import EngineError
from spherekit.model.expression import ON_ARRAYS
from spherekit.sphere.rotation import Floats

Numbers = NDArray[Any]
"""An array of the numbers of one arithmetic."""

DIGITS = 50
"""Decimal digits of `Digits` unless others are asked for."""

FEWEST, MOST = 20, 300


class Arithmetic(ABC):
    """A kind of numbers: `name`, decimal `digits`, and `eps`, their spacing just above 1.

    Sums, products and quotients are those of NumPy; what NumPy cannot do for all kinds
    is here.
    """

    name: str
    digits: int
    eps: float

    @abstractmethod
    def exact(self, values: ArrayLike) -> Numbers:
        """Return float64 numbers as they are."""

    @abstractmethod
    def floats(self, values: Numbers) -> Floats:
        """Return the nearest float64 numbers."""

    @abstractmethod
    def root(self, values: Numbers) -> Numbers:
        """Return square roots."""

    @abstractmethod
    def cosine_sine(self, angles: Numbers) -> tuple[Numbers, Numbers]:
        """Return cosines and sines of angles (rad)."""

    @abstractmethod
    def function(self, name: str, *arguments: Numbers) -> Numbers:
        """Return a function of expressions (`spherekit.model.expression`) without kinks.

        NaN outside its domain.
        """

    @abstractmethod
    def pi(self) -> Any:
        """Return the circle's number."""

    def zeros(self, *shape: int) -> Numbers:
        """Return zeros of this arithmetic."""
        return self.exact(np.zeros(shape))


@final
class Hardware(Arithmetic):
    """Floats of the machine: the widest NumPy has, all rows at once.

    Raises
    ------
    EngineError
        If the machine has none wider than float64, unless `dtype` says that will do.
    """

    def __init__(self, dtype: Any = np.longdouble) -> None:
        info = np.finfo(dtype)
        if dtype is np.longdouble and float(info.eps) > 1e-18:
            raise EngineError(
                "longdouble is no wider than float64 on this machine",
                "use Digits(20) or more of spherekit.exact.arithmetic",
            )
        self.name = np.dtype(dtype).name
        self.digits = int(info.precision)
        self.eps = float(info.eps)
        self._dtype = dtype

    def exact(self, values: ArrayLike) -> Numbers:
        """See `Arithmetic`."""
        return np.asarray(values, dtype=float).astype(self._dtype)

    def floats(self, values: Numbers) -> Floats:
        """See `Arithmetic`."""
        return np.asarray(values).astype(float)

    def root(self, values: Numbers) -> Numbers:
        """See `Arithmetic`."""
        return np.asarray(np.sqrt(values))

    def cosine_sine(self, angles: Numbers) -> tuple[Numbers, Numbers]:
        """See `Arithmetic`."""
        return np.cos(angles), np.sin(angles)

    def function(self, name: str, *arguments: Numbers) -> Numbers:
        """See `Arithmetic`."""
        with np.errstate(all="ignore"):
            return np.asarray(ON_ARRAYS[name](*arguments))

    def pi(self) -> Any:
        """See `Arithmetic`."""
        return self._dtype(4.0) * np.arctan(self._dtype(1.0))


@final
@checked_class(EngineError)
class Digits(Arithmetic):
    """Numbers of mpmath with any number of decimal digits, slow and exact.

    Raises
    ------
    EngineError
        If fewer than 20 or more than 300 digits are asked for.
    """

    def __init__(self, digits: int = DIGITS) -> None:
        if not FEWEST <= digits <= MOST:
            raise EngineError(
                f"{digits} digits were asked for; give between {FEWEST} and {MOST}"
            )
        import mpmath

        context = mpmath.mp.clone()
        context.dps = digits
        self.name = f"{digits} digits"
        self.digits = digits
        self.eps = float(context.eps)
        self._context = context
        self._made = np.frompyfunc(context.mpf, 1, 1)
        self._float = np.frompyfunc(float, 1, 1)
        self._root = np.frompyfunc(context.sqrt, 1, 1)
        self._turn = np.frompyfunc(context.cos_sin, 1, 2)

    def exact(self, values: ArrayLike) -> Numbers:
        """See `Arithmetic`."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self._made(np.asarray(values, dtype=float)), dtype=object)

    def floats(self, values: Numbers) -> Floats:
        """See `Arithmetic`."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self._float(values), dtype=float)

    def root(self, values: Numbers) -> Numbers:
        """See `Arithmetic`."""
        return np.asarray(self._root(values), dtype=object)

    def cosine_sine(self, angles: Numbers) -> tuple[Numbers, Numbers]:
        """See `Arithmetic`."""
        cosine, sine = self._turn(angles)
        return np.asarray(cosine, dtype=object), np.asarray(sine, dtype=object)

    def function(self, name: str, *arguments: Numbers) -> Numbers:
        """See `Arithmetic`."""
        context = self._context
        operation = getattr(context, name, None) or ON_ARRAYS[name]

        def real(*given: Any) -> Any:
            try:
                value = operation(*given)
            except ZeroDivisionError:
                return context.nan
            return context.nan if isinstance(value, context.mpc) else value

        made = np.frompyfunc(real, len(arguments), 1)(*arguments)
        return np.asarray(made, dtype=object)

    def pi(self) -> Any:
        """See `Arithmetic`."""
        return +self._context.pi


def wide() -> Arithmetic:
    """Return the quickest arithmetic that is wider than float64 on this machine."""
    try:
        return Hardware()
    except EngineError:
        return Digits(FEWEST)
