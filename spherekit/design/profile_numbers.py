"""What profiles are where contacts touch them, by any number of the file.

Configurations that follow from one design to another, in steps that do not leap.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.design.variables import ACTIONS, DesignVariable, designed, slope_by
from spherekit.engine.design_kernel import At, PathKernel
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.model.gears import TOUCHING, geometry_of
from spherekit.model.joints import Track
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry, Profile
from spherekit.motion.loops import contact_tracks
from spherekit.sphere.rotation import all_finite, nans
from spherekit.sphere.varied_curve import (
    DrawnCurves,
    VariedCurve,
    varied_round,
    varied_through,
)

NEWTON_STEPS = 12
"""Most steps from the configuration of one design to that of the next."""
SHRINKING = 0.125, 0.03125
"""Steps that shrink by this part lead to the nearest configuration: of small deviations,
of others."""
SHORTEST = 2.0**-16
"""Part of a way below which it is not followed: no configuration is ahead."""
STILL = 1e-9
"""Steps (rad) so short do not leap."""
CLOSED = 1e-12
"""A configuration whose pairs miss each other by less (rad) is closed."""
MISSED = 100.0
"""Pairs that miss each other by more than so many of the steps do not close: steps of
constraints that repeat each other come to rest where these contradict."""
NOTHING = 1e-15
"""A next step (rad) that need not be made, and"""
NEARLY = 1e-6
"""one that need not on the way."""
SURE = 0.05
"""A fold is there when it is foreseen twice at places that differ by this part of the way
that is left to it, and"""
TOWARDS = 0.45
"""ways go towards it by this part."""
MARGIN, LEAST, LONGEST = 0.8, 1.0 / 16.0, 4.0
"""Parts of ways change by these factors at least and at most, so that steps shrink by more
than they have to."""
SOON = 2.0**-8
"""Part of a way at which it is looked at first, for its direction."""
BLOCK = 4096
"""Configurations that are followed together."""

Profiles = Callable[[Floats, Indices, Floats], Floats]
"""Columns (w, k) of profiles at variables (v, k) of rows (k,) at parts (k,) of their ways.

NaN where there is no design."""


def followed(
    newton: PathKernel,
    start: Floats,
    sizes: Floats,
    away: Floats,
    profiles: Profiles | None = None,
    short: bool = False,
    turned: Mapping[int, float] = MappingProxyType({}),
) -> tuple[Floats, Bools]:
    """Return the variables (v, m) that follow to sizes (k, m), and which get there.

    Parameters
    ----------
    newton
        Newton's step of the topology.
    start
        (v, m) closed configurations of the designs with sizes `sizes - away`.
    sizes, away
        (k, m) rad and SI, where the ways end, and what that is from where they begin.
    profiles
        The columns of profiles, where some are handed in.
    short
        Whether ways are those of small deviations. They end at a fold that is foreseen
        twice: there the square of the determinant falls to zero linearly. Others are
        followed up to it, in steps that shrink more.
    turned
        By how much inputs turn along the way (rad), by their variables.

    Notes
    -----
    In parts of the way, shorter where Newton's steps do not shrink at once or the
    determinant of the closure equations changes its sign, so that none leaps to another
    assembly mode.
    """
    ways = _Ways(newton, start, sizes, away, profiles, short, turned)
    while len(left := np.flatnonzero((ways.gone < 1.0) & (ways.part >= SHORTEST))):
        for some in _blocks(left):
            ways.advance(some)
    return ways.values[1], ways.gone >= 1.0


def _blocks(rows: Indices) -> list[Indices]:
    """Return rows in blocks that stay in the cache."""
    return [rows[start : start + BLOCK] for start in range(0, len(rows), BLOCK)]


class _Ways:
    """The ways of variables (v, m) so far, and on by a cubic through where they were.

    `gone` and `part` (m,) are how far they have come and what is tried next, `slope` (v, m)
    their direction at the start, `places` (2, m) and `values` (2, v, m) the last two
    arrivals. The determinant has the sign `side` (m,); its `squares` at the last arrival
    foresee `folds`, infinite where none.
    """

    def __init__(
        self,
        newton: PathKernel,
        start: Floats,
        sizes: Floats,
        away: Floats,
        profiles: Profiles | None,
        short: bool,
        turned: Mapping[int, float],
    ) -> None:
        self.newton, self.profiles, self.short = newton, profiles, short
        self.start, self.sizes, self.away = start, sizes, away
        m, self.shrinking = sizes.shape[1], SHRINKING[0 if short else 1]
        self.gone, self.part, self.folds = np.zeros(m), np.ones(m), np.full(m, np.inf)
        self.places, self.values = np.zeros((2, m)), np.stack([start, start])
        self.slope, self.side, self.squares = np.zeros_like(start), np.zeros(m), np.zeros(m)
        for some in _blocks(np.arange(m)):
            soon = np.full(len(some), SOON)
            onward = start[:, some].copy()
            for variable, turn in turned.items():
                onward[variable] += SOON * turn
            begun = self._step(onward, self._prepared(some, soon), some, soon)
            moved = onward - start[:, some] + begun.step
            finite = all_finite([*moved, begun.determinant], 0)
            self.slope[:, some] = np.where(finite, moved / SOON, 0.0)
            self.side[some] = np.sign(begun.determinant)
            self.squares[some] = begun.determinant**2

    def advance(self, some: Indices) -> None:
        """Try the next parts of some ways; they become shorter where these do not hold."""
        ahead = np.minimum(self.gone[some] + self.part[some], 1.0)
        now, determinant, shrunk, holds = self._corrected(some, ahead)
        arrived, there = some[holds], ahead[holds]
        with np.errstate(all="ignore"):
            factor = MARGIN * self.shrinking / shrunk
        most = np.where(holds, LONGEST, 0.5)
        part = (ahead - self.gone[some]) * np.minimum(np.maximum(factor, LEAST), most)
        if self.short:
            part[holds] = self._before_folds(
                arrived, there, determinant[holds], part[holds]
            )
        self.gone[arrived] = there
        self.places[:, arrived] = self.places[1, arrived], there
        self.values[0][:, arrived] = self.values[1][:, arrived]
        self.values[1][:, arrived] = now[:, holds]
        self.part[some] = np.exp2(np.floor(np.log2(np.maximum(part, 0.5 * SHORTEST))))

    def _before_folds(
        self, rows: Indices, places: Floats, determinant: Floats, part: Floats
    ) -> Floats:
        """Return the next parts of ways that have come to places; 0 where they end."""
        square = determinant**2
        with np.errstate(all="ignore"):
            falls = (self.squares[rows] - square) / (places - self.places[1, rows])
            left = np.where(falls > 0.0, square / falls, np.inf)
            fold = places + left
            ends = np.abs(fold - self.folds[rows]) < SURE * left
        ends &= fold + left < 1.0
        self.squares[rows], self.folds[rows] = square, fold
        shorter = np.minimum(part, np.maximum(TOWARDS * left, SHORTEST))
        return np.where(ends, 0.0, shorter)

    def _foreseen(self, rows: Indices, t: Floats) -> tuple[Floats, Floats]:
        """Return the variables (v, k) foreseen at places, and how far these are."""
        start, slope = self.start[:, rows], self.slope[:, rows]
        (one, two), (first, last) = self.places[:, rows], self.values[:, :, rows]
        with np.errstate(all="ignore"):
            bend, other = (
                np.where(place > 0.0, (values - start - slope * place) / place**2, 0.0)
                for place, values in ((two, last), (one, first))
            )
            twist = np.where(one > 0.0, (bend - other) / (two - one), 0.0)
        made = start + t * (slope + t * (bend + (t - two) * twist))
        away = made - last
        return made, np.sqrt(np.einsum("vk,vk->k", away, away))

    def _prepared(self, rows: Indices, ahead: Floats) -> Floats:
        sizes = self.sizes[:, rows] - (1.0 - ahead) * self.away[:, rows]
        return np.asarray(self.newton.prepare(np.ascontiguousarray(sizes)))

    def _step(self, now: Floats, prepared: Floats, rows: Indices, ahead: Floats) -> At:
        """Return the equations at variables (v, k)."""
        rest = prepared
        if self.profiles is not None:
            rest = np.concatenate([self.profiles(now, rows, ahead), prepared])
        with np.errstate(all="ignore"):
            return self.newton.at(now, rest)

    def _corrected(
        self, rows: Indices, ahead: Floats
    ) -> tuple[Floats, Floats, Floats, Bools]:
        """Return where Newton's method leads from foreseen variables, and who holds.

        With the determinants there, and by what part of a step the worst one shrank. It
        holds where each step is this part of the one before at most (Kantorovich 1948), and
        the determinant keeps its sign. A configuration is left where a step is too long,
        and is there when the next step would be nothing, by how the last ones shrank; on
        the way, when it would not matter.
        """
        made, before = self._foreseen(rows, ahead)
        determinant, shrank = np.zeros((2, len(rows)))
        holds = np.zeros(len(rows), dtype=bool)
        left, goes_on = np.arange(len(rows)), np.ones(len(rows), dtype=bool)
        enough = np.where(ahead < 1.0, NEARLY, NOTHING)
        prepared = self._prepared(rows, ahead)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                now = made if len(left) == len(rows) else made[:, left]
                here = self._step(now, prepared, rows[left], ahead[left])
                step = here.step
                length = np.sqrt(np.einsum("vk,vk->k", step, step))
                shrinks = goes_on & (length <= np.maximum(self.shrinking * before, STILL))
                shrunk = np.where(goes_on & (length > STILL), length / before, 0.0)
                shrank[left] = np.maximum(shrank[left], shrunk)
                still = length * (length / before) ** 2 < enough[left]
                still &= here.open <= (MISSED * length) ** 2
                ends = shrinks & (still | (here.open < CLOSED**2))
                same_side = np.sign(here.determinant) == self.side[rows[left]]
                holds[left[ends & same_side]] = True
                made[:, left[shrinks]] += step[:, shrinks]
                determinant[left[goes_on]] = here.determinant[goes_on]
                goes_on, before = shrinks & ~ends, length
                if not np.any(goes_on):
                    break
                if 2 * np.count_nonzero(goes_on) < len(left):
                    left, before = left[goes_on], before[goes_on]
                    prepared = prepared[:, goes_on]
                    goes_on = np.ones(len(left), dtype=bool)
        return made, determinant, shrank, holds


STEPS = 2.0 ** -np.array([5.0, 9.0, 13.0])
"""Differences of numbers of the file that are tried until all of them are allowed."""
APART = 0.2
"""Profiles of a reference pose that deviations take off each other by less (rad) touch
where they are nearest."""


def has_other_profiles(mechanism: Mechanism) -> bool:
    """Return whether a profile is no circle: then what profiles are is handed in."""
    return any(
        profile.round_axis is None
        for pair in mechanism.pairs
        for profile in pair.profiles or ()
    )


class ProfileNumbers:
    """The columns of all profiles of a mechanism, and their derivatives by its numbers.

    Columns (9, n) of a profile are its tangent, its point, the curvature and the first and
    second derivative of that by the arc length, at a place that its pair variable says.
    """

    def __init__(
        self,
        document: Document,
        variables: Sequence[DesignVariable],
        values: Floats,
        mechanism: Mechanism | None = None,
    ) -> None:
        """Take them at numbers (variables,) of the file; `mechanism` is that, if known.

        Raises
        ------
        FileError, ModelError
            If there is no such mechanism.
        """
        self.document, self.variables, self.values = document, tuple(variables), values
        self.mechanism = mechanism or designed(document, variables, values.tolist())
        self.tracks = tracks_of(self.mechanism)

    def columns(self, values: Floats) -> Floats:
        """Return the columns (9 profiles, n) at pair variables (n, w)."""
        return columns_of(self.tracks, values)

    def towards(self, deviations: Floats) -> Profiles:
        """Return the profiles on the ways to deviating designs (variables, draws).

        Draw by draw at each row. On the way they are between those at its ends.
        """
        drawn = [self._tracks(self.values + deviation) for deviation in deviations.T]
        possible = np.array([tracks is not None for tracks in drawn])
        every = [
            _drawn(track, [tracks[k] if tracks else track for tracks in drawn])
            for k, track in enumerate(self.tracks)
        ]

        def profiles(now: Floats, rows: Indices, ahead: Floats) -> Floats:
            draws = rows % len(drawn)
            there = np.concatenate([columns(now, draws) for columns in every])
            there[:, ~possible[draws]] = np.nan
            some = np.flatnonzero(ahead < 1.0)
            if len(some):
                nominal = columns_of(self.tracks, now[:, some].T, last=False)
                there[:, some] = _between(nominal, there[:, some], ahead[some])
            return there

        return profiles

    def _tracks(self, values: Floats) -> list[Track] | None:
        """Return the profiles of a design (variables,), None if there is no such design."""
        try:
            made = designed(self.document, self.variables, list(values))
            return tracks_of(made, APART)
        except SpherekitError:
            return None

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives (variables, 8 profiles, n) of all but the last columns.

        The pair variables (n, w) held.

        Raises
        ------
        DesignError
            If the mechanism does not allow other values of a variable.
        """
        made = np.zeros((len(self.variables), 8 * len(self.tracks), len(values)))
        along = _along(self.columns(values))
        for k, curves in enumerate(self._varied):
            for place, curve in curves.items():
                track = self.tracks[place]
                arcs = values[:, track.variable] + track.start
                made[k, 8 * place : 8 * place + 8] = curve.at(arcs)
            for place, moved in self._starts(curves).items():
                rows = slice(8 * place, 8 * place + 8)
                made[k, rows] += moved * along[place]
        return made

    def _starts(self, curves: Mapping[int, VariedCurve]) -> dict[int, float]:
        """Return how the starts of profiles move that roll from a reference pose."""
        made: dict[int, float] = {}
        for first, second in pairwise(range(len(self.tracks))):
            both = self.tracks[first], self.tracks[second]
            rolling = both[0].variable == both[1].variable
            changed = first in curves or second in curves
            if self._posed and rolling and changed:
                moved = _nearest(both, (curves.get(first), curves.get(second)))
                made |= dict(zip((first, second), moved, strict=True))
        return made

    @property
    def _posed(self) -> bool:
        return isinstance(self.mechanism.geometry, PoseGeometry)

    @cached_property
    def _varied(self) -> list[dict[int, VariedCurve]]:
        """Return for each variable the profiles that change with it, by their numbers."""
        profiles = profiles_of(self.mechanism)
        made: list[dict[int, VariedCurve]] = []
        for k, variable in enumerate(self.variables):
            made.append({})
            if variable.slot is not None or variable.path[0] in ACTIONS:
                continue
            changes = slope_by(self._numbers, self.values, k, STEPS)
            if changes is None:
                raise DesignError(
                    f"{self.document.name}: the file allows no other {variable.key}; vary "
                    "a number that may change on its own"
                )
            at = 0
            for place, (profile, backwards) in enumerate(profiles):
                size = len(numbers_of(profile))
                change = changes[at : at + size]
                at += size
                if np.any(change):
                    made[-1][place] = varied(profile, change, backwards)
        return made

    def _numbers(self, values: Floats) -> Floats | None:
        """Return the numbers of all profiles of a design, None if there is none."""
        try:
            made = designed(self.document, self.variables, list(values))
        except SpherekitError:
            return None
        return np.concatenate([numbers_of(profile) for profile, _ in profiles_of(made)])


def _drawn(nominal: Track, tracks: Sequence[Track]) -> Callable[[Floats, Indices], Floats]:
    """Return the columns (9, n) of a profile of designs near a nominal one.

    At variables (v, n) of designs (n,); of all curves at once where they can be.
    """
    curves = DrawnCurves.of(nominal.curve, [track.curve for track in tracks])
    starts = np.array([track.start for track in tracks])

    def columns(now: Floats, draws: Indices) -> Floats:
        there = nans((9, len(draws)))
        if curves is not None:
            there[:8] = curves.at(now[nominal.variable] + starts[draws], draws)
            return there
        for draw in np.unique(draws):
            some = np.flatnonzero(draws == draw)
            there[:, some] = columns_of([tracks[draw]], now[:, some].T, last=False)
        return there

    return columns


def tracks_of(mechanism: Mechanism, apart: float = TOUCHING) -> list[Track]:
    """Return the profiles of all contacts, in the order of `TurningPairs.columns`."""
    contacts = contact_tracks(geometry_of(mechanism, apart).joints)
    return [track for _, tracks in contacts for track in tracks]


def profiles_of(mechanism: Mechanism) -> list[tuple[Profile, bool]]:
    """Return the profiles in the order of `tracks_of`, and which run backwards."""
    return [
        (profile, side == 1 and pair.contact == "external")
        for pair in mechanism.pairs
        for side, profile in enumerate(pair.profiles or ())
    ]


def numbers_of(profile: Profile) -> Floats:
    """Return what a profile is made from: centre, radius, points, cosines and sines."""
    radius = () if profile.radius is None else (profile.radius,)
    points = np.ravel(profile.points)
    return np.concatenate(
        [profile.centre or (), radius, points, profile.cosines, profile.sines]
    )


def varied(profile: Profile, change: Floats, backwards: bool) -> VariedCurve:
    """Return a profile with its derivatives, `change` being that of its numbers."""
    if profile.points:
        moved = change.reshape(-1, 3)
        return varied_through(profile.points, moved, profile.closed, backwards)
    centre = np.array(profile.centre), change[:3]
    if profile.round_axis is not None:
        radius = 0.5 * np.pi if profile.radius is None else profile.radius
        longer = 0.0 if profile.radius is None else change[3]
        return varied_round(centre, ([radius], [longer]), backwards=backwards)
    even = len(profile.cosines)
    cosines = profile.cosines, change[3 : 3 + even]
    sines = profile.sines, change[3 + even :]
    return varied_round(centre, cosines, sines, backwards)


def _along(columns: Floats) -> Floats:
    """Return how columns change along profiles, (profiles, 8, n), from columns of these."""
    made = []
    for column in columns.reshape(-1, 9, columns.shape[1]):
        tangent, point, curvature = column[:3], column[3:6], column[6]
        normal = np.cross(point, tangent, axis=0)
        made.append(np.concatenate([curvature * normal - point, tangent, column[7:]]))
    return np.stack(made)


def _nearest(
    tracks: tuple[Track, Track], curves: tuple[VariedCurve | None, VariedCurve | None]
) -> tuple[float, float]:
    """Return how the places move where two profiles are nearest, as these change.

    By least squares, from how far their frames turn from each other.
    """
    columns, turned = [], np.zeros(3)
    for track, curve, sign in zip(tracks, curves, (1.0, -1.0), strict=True):
        start = np.array([track.start])
        there = track.curve.at(start)
        tangent, normal, point = there.frame[0].T
        columns.append(sign * (normal + there.curvature[0] * point))
        if curve is not None:
            change = curve.at(start)[:, 0]
            leaning, running = -change[3:6] @ normal, change[3:6] @ tangent
            swinging = change[:3] @ normal
            turned += sign * (leaning * tangent + running * normal + swinging * point)
    moved, *_ = np.linalg.lstsq(np.stack(columns, axis=1), -turned, rcond=None)
    return float(moved[0]), float(moved[1])


def columns_of(tracks: Sequence[Track], values: Floats, last: bool = True) -> Floats:
    """Return the columns (9 profiles, n) of profiles at pair variables (n, w).

    With the `last` of each, or NaN there; NaN where variables are.
    """
    made = nans((9 * len(tracks), len(values)))
    finite = np.flatnonzero(all_finite(values, 1))
    for k, track in enumerate(tracks):
        arcs = values[finite, track.variable] + track.start
        there = track.curve.at(arcs)
        column = nans((9, len(finite)))
        column[:3], column[3:6] = there.frame[:, :, 0].T, there.frame[:, :, 2].T
        column[6], column[7] = there.curvature, there.curvature_rate
        if last:
            column[8] = track.curve.curvature_second(arcs)
        column[:, ~there.inside] = np.nan
        made[9 * k : 9 * k + 9, finite] = column
    return made


def _between(one: Floats, other: Floats, part: Floats) -> Floats:
    """Return columns (9 profiles, n) at parts (n,) between two: frames stay frames."""
    made = one + part * (other - one)
    for k in range(0, len(made), 9):
        tangent, point = made[k : k + 3], made[k + 3 : k + 6]
        point /= np.sqrt(np.sum(point * point, axis=0))
        tangent -= np.sum(tangent * point, axis=0) * point
        tangent /= np.sqrt(np.sum(tangent * tangent, axis=0))
    return made
