"""Checks modes counted system by system, and maps of two inputs, without spherekit.

With e^(i angle) = a / b, a rotation times a b is a polynomial in a and b. A point is (z,
1), or (1, w) with the inverse w, so an angle at infinity is a solution like any other.

A system is a part of the equations with its own unknowns, given the angles of earlier
systems. In certificates it is a dictionary ("part") with the links of its equations, its
unknowns, and solutions at some angles ("solved") to start from. `Half` (of `proof_checker`)
evaluates the equations of a system and their derivatives, in a and b of its unknowns.

`arb` and `acb` are real and complex balls: numbers with rigorous bounds of their errors.
"""

from itertools import combinations, product

import numpy as np
from flint import acb, acb_poly, arb, ctx
from oracles.proof_checker import (
    Half,
    System,
    about,
    ball,
    inverse_near,
    largest,
    mid,
    need,
    permanent_of,
    square,
    wrapped,
)

DEEPEST = 7
"""Largest number of times that a box is halved to show that it is regular."""


def plain(inverse, z):
    """Return the pair (a, b) of e^(i angle) = a / b.

    `z` is e^(i angle), or its inverse if `inverse` is true.
    """
    return (acb(1), z) if inverse else (z, acb(1))


def check_parts(system, parts):
    """Check that the systems contain every equation once and can be solved in order.

    The equations of a system may contain its own unknowns, those of earlier systems, and
    the inputs.

    Parameters
    ----------
    system
        All equations of the mechanism. `system.onto` are the steps of its construction that
        put a link on two axes; each of them gives one equation.
    parts
        The systems of the certificate, in the order in which they are solved.

    Returns
    -------
    bounds
        Largest number of solutions of each system: the permanent of the degrees of its
        equations in its unknowns (multihomogeneous theorem of Bezout).
    table
        Degrees of each equation in all unknowns, by link.
    """
    links = [step["link"] for step in system.onto]
    table = dict(zip(links, system.degrees(), strict=True))
    remaining = dict(table)
    solved_unknowns = set()
    bounds = []
    for part in parts:
        rows = [remaining.pop(link) for link in part["equations"]]
        solved_unknowns |= set(part["unknowns"])
        used = set()
        for row in rows:
            used |= {x for x, degree in zip(system.unknowns, row, strict=True) if degree}
        need(used <= solved_unknowns, "a system with unknowns of a later one")
        columns = [system.unknowns.index(name) for name in part["unknowns"]]
        need(len(columns) == len(rows), "a system that is not square")
        bounds.append(permanent_of([[row[c] for c in columns] for row in rows]))
    is_everything = not remaining and solved_unknowns == set(system.unknowns)
    need(is_everything, "equations are missing")
    return bounds, table


def check_systems(system, certificate, driven):
    """Show that there are as many real modes as roots are given."""
    ctx.prec = 80
    centre = [driven[name] for name in system.inputs]
    # A box without extent: the inputs themselves.
    half_widths = [0.0] * len(centre)
    mode_counter = ModeCounter(system, certificate["systems"])
    mode_count = mode_counter.count_modes(centre, half_widths)
    need(mode_count == certificate["modes"], "another number of modes by systems")


def roots_of(system, part, driven):
    """Return approximations of all solutions of one equation in one unknown.

    The equation is a polynomial in z = e^(i angle). Its coefficients follow from its values
    at roots of unity (a discrete Fourier transform).

    Parameters
    ----------
    system
        All equations of the mechanism.
    part
        The system: one equation, its unknown, and its degree.
    driven
        Angles (balls, rad) of the inputs and of the unknowns of earlier systems.

    Returns
    -------
    list of (inverse, [z])
        `inverse` is [True] if z is the inverse of e^(i angle), so that |z| is at most 1.
    """
    (link,) = part["equations"]
    (name,) = part["unknowns"]
    # The equation as a function of z, and not of its inverse.
    equations = Half(system, [link], [name], [False])
    count = part["degree"] + 1
    nodes = [acb(0, 2 * arb.pi() * k / count).exp() for k in range(count)]
    # The middles of the given angles, without their errors.
    middle = {pair: arb(angle.mid()) for pair, angle in driven.items()}
    values = [equations.values([z], middle)[0][0] for z in nodes]
    # Coefficient k is the mean of value / z^k over the nodes. As z^count is 1 there,
    # z^(count - k) is 1 / z^k.
    coefficients = []
    for k in range(count):
        terms = [v * z ** (count - k) for v, z in zip(values, nodes, strict=True)]
        coefficients.append(sum(terms) / count)
    polynomial = acb_poly([acb(x.mid()) for x in coefficients])
    points = []
    for root in polynomial.roots(tol=1e-15):
        z = acb(root.mid())
        is_large = abs(complex(float(z.real), float(z.imag))) > 1
        points.append(([is_large], [acb((1 / z).mid()) if is_large else z]))
    return points


STEP = 0.05
"""Largest change (rad) of a given angle in one step along which solutions are followed."""


def follow_solutions(system, part, driven):
    """Return approximations of all solutions of a system at given angles.

    The certificate states all solutions at some choices of the given angles. From the
    nearest choice, the given angles move to the present ones in small steps. After each
    step Newton's method corrects every solution.

    Parameters
    ----------
    system
        All equations of the mechanism.
    part
        The system of equations that is solved.
    driven
        Angles (balls, rad) of the inputs and of the unknowns of earlier systems.

    Returns
    -------
    list of (inverse, z)
        For each unknown e^(i angle), or its inverse if `inverse` is true. The smaller one
        is used, so that angles at infinity are ordinary numbers.
    """
    need(part["solved"], "a system without solutions to start from")
    middle = {pair: float(angle.mid()) for pair, angle in driven.items()}

    def gaps_to(stated):
        """Return by how much given angles differ from those of a stated choice."""
        given = stated["given"]
        pairs = [pair for pair in part["used"] if pair in given]
        return {pair: wrapped(middle[pair] - given[pair]) for pair in pairs}

    start = min(part["solved"], key=lambda x: max(map(abs, gaps_to(x).values())))
    gaps = gaps_to(start)
    step_count = 1 + int(max(map(abs, gaps.values())) / STEP)
    points = []
    for solution in start["solutions"]:
        inverse = list(solution["inverse"])
        z = [acb(*parts) for parts in solution["z"]]
        for step in range(1, step_count + 1):
            remaining = 1 - step / step_count
            place = {
                pair: arb(angle - gaps.get(pair, 0.0) * remaining)
                for pair, angle in middle.items()
            }
            for column, value in enumerate(z):
                # A large number is replaced by its inverse.
                if abs(value) > 2:
                    inverse[column] = not inverse[column]
                    z[column] = (1 / value).mid()
            equations = Half(system, part["equations"], part["unknowns"], inverse)
            for _ in range(4):
                value, slope = equations.values(z, place)
                z = list(mid(np.array(z) - inverse_near(slope) @ mid(value)))
        points.append((inverse, z))
    return points


class ModeCounter:
    """Counts the assembly modes over boxes of the inputs, system by system.

    An assembly mode is one of the ways to assemble the mechanism: a real solution.
    """

    def __init__(self, system, parts):
        """Check the systems, and add their degrees and the angles in them (`used`)."""
        self.system = system
        self.parts = parts
        bounds, table = check_parts(system, parts)
        for part, bound in zip(parts, bounds, strict=True):
            part["degree"] = bound
            rows_of = [table[link] for link in part["equations"]]
            columns = zip(system.unknowns, *rows_of, strict=True)
            part["used"] = {name for name, *row in columns if any(row)} | set(system.inputs)

    def count_modes(self, centre, half_widths):
        """Return the number of modes in a box if it is proven to be constant, else None.

        Systems are solved one after another. All complex solutions of a system are enclosed
        over the whole box and shown to be different. So none of them vanishes, and a real
        one stays real. Each real solution starts one path for the systems after it: a
        mapping from the angles so far to triples. An angle is a linear function of the
        inputs plus a remainder. The triple has its value at the centre of the box, its
        rates by the inputs, and a bound of the remainder.

        Parameters
        ----------
        centre, half_widths
            Centre and half widths (inputs,) of the box, rad.
        """
        count = len(centre)
        input_angles = {}
        for k, (name, middle) in enumerate(zip(self.system.inputs, centre, strict=True)):
            rates = [int(k == j) for j in range(count)]
            input_angles[name] = (arb(middle), rates, arb(0))
        paths = [input_angles]
        try:
            for part in self.parts:
                next_paths = []
                for path in paths:
                    for angles in self._solve(part, path, half_widths):
                        unknowns = dict(zip(part["unknowns"], angles, strict=True))
                        next_paths.append({**path, **unknowns})
                paths = next_paths
        # The other errors arise if a ball contains zero where it must not.
        except (NotShown, ZeroDivisionError, ValueError):
            return None
        return len(paths)

    def _solve(self, part, path, half_widths):
        """Return the angles of all real solutions of a system over a box of inputs.

        All complex solutions are enclosed and shown to be different. `NotShown` is raised
        unless there are as many as the bound of the system, so none can be missing.

        Parameters
        ----------
        part
            The system.
        path
            Inputs and unknowns of earlier systems by name. Each is a triple: its value at
            the centre of the box, its rates by the inputs, and a bound of the remainder.
        half_widths
            Half widths (inputs,) of the box, rad.

        Returns
        -------
        For each real solution a list with a triple for each unknown.
        """
        has_one_unknown = len(part["unknowns"]) == 1
        middle = {name: angle for name, (angle, _, _) in path.items()}
        find_points = roots_of if has_one_unknown else follow_solutions
        points = find_points(self.system, part, middle)
        if len(points) != part["degree"]:
            raise NotShown
        real = []
        balls = []
        for inverse, centre in points:
            solution = SolutionOverBox(
                self.system, part, path, half_widths, inverse, centre
            )
            enclosure = solution.ball()
            # The points (a, b) of all e^(i angle) = a / b.
            balls.append([plain(i, z) for i, z in zip(inverse, enclosure, strict=True)])
            # An angle is real if |e^(i angle)| is 1.
            may_be_real = all(abs(z).contains(1) for z in enclosure)
            if may_be_real:
                solution.show_real()
                real.append(solution.angles())
        for first, second in combinations(balls, 2):
            # Two points (a, b) and (c, d) are equal if a d = b c.
            pairs = zip(first, second, strict=True)
            if all((a * d - b * c).contains(0) for (a, b), (c, d) in pairs):
                raise NotShown
        return real


class SolutionOverBox:
    """One solution of a system over a box of inputs: z + Z d + w.

    d are the inputs less the centre of the box. z is the solution at the centre, Z d its
    linear part, and w a remainder, which is bounded for all d at once by Krawczyk's
    operator. The components are e^(i angle) of the unknowns, or their inverses.

    Attributes
    ----------
    centre, rates
        (k,) z, and (k, inputs) Z.
    steps
        (inputs,) balls that contain all d.
    given
        By name: balls of the inputs and of the unknowns of earlier systems over the box.
    preconditioner
        (k, k) Y, near the inverse of the derivatives by the unknowns at the centre.
    linear_part
        (k,) balls that contain all z + Z d.
    start
        (k,) balls that contain -Y P at all z + Z d, with the equations P = 0.
    radius
        Bound of the real and the imaginary part of each component of w.
    remainder
        (k,) balls that contain all w.
    """

    def __init__(self, system, part, path, half_widths, inverse, centre):
        """Enclose one solution of a system over a box of inputs, or raise `NotShown`.

        Parameters
        ----------
        system, part
            All equations, and the system that is solved.
        path
            Inputs and unknowns of earlier systems by name. Each is a triple: its value at
            the centre of the box, its rates by the inputs, and a bound of the remainder.
        half_widths
            Half widths (inputs,) of the box, rad.
        inverse, centre
            Approximation of the solution at the centre of the box: e^(i angle) of each
            unknown, or its inverse where `inverse` is true.
        """
        self.inverse = inverse
        self.centre = np.array(centre)
        given_names = list(path)
        count = len(centre)
        # Derivatives of the equations are by the k unknowns first, then by given angles.
        self.equations = Half(
            system, part["equations"], part["unknowns"], inverse, given_names
        )
        self.steps = about(half_widths)
        self.identity = ball(np.eye(count))

        # The given angles at the centre, and over the whole box.
        middle = {name: path[name][0] for name in given_names}
        rates_of_given = ball([path[name][1] for name in given_names])
        remainder_of_given = about([path[name][2] for name in given_names])
        change_of_given = rates_of_given @ self.steps + remainder_of_given
        self.given = {
            name: middle[name] + change
            for name, change in zip(given_names, change_of_given, strict=True)
        }

        # The linear part follows from the derivatives at the centre: P' Z = -P'_given.
        value, slope = self.equations.values(centre, middle)
        self.preconditioner = inverse_near(slope[:, :count])
        self.rates = mid(-self.preconditioner @ (slope[:, count:] @ rates_of_given))
        self.linear_part = self.centre + self.rates @ self.steps

        # The equations at all z + Z d, by the mean value theorem: the value at the centre,
        # plus the derivatives over the box times the changes of unknowns and given angles.
        _, slope = self.equations.values(self.linear_part, self.given)
        slope_by_unknowns = slope[:, :count]
        slope_by_given = slope[:, count:]
        slope_by_inputs = slope_by_unknowns @ self.rates + slope_by_given @ rates_of_given
        linear_change = slope_by_inputs @ self.steps
        self.start = -self.preconditioner @ (
            value + linear_change + slope_by_given @ remainder_of_given
        )
        # The operator maps 0 to `start`, so w is about as large. The radius is a little
        # larger, and `image` shows whether it is large enough.
        self.radius = 1.5 * largest(self.start) + arb(1e-14)
        self.remainder = self.image(self.radius)

    def image(self, radius):
        """Return the image of all w of a radius by Krawczyk's operator.

        `NotShown` is raised unless the image lies within the radius. If it does, there is
        exactly one solution z + Z d + w with such a w for every d.
        """
        around = np.full(len(self.centre), square(radius))
        _, slope = self.equations.values(self.linear_part + around, self.given)
        slope_by_unknowns = slope[:, : len(self.centre)]
        contraction = self.identity - self.preconditioner @ slope_by_unknowns
        image = self.start + contraction @ around
        if not largest(image) < radius:
            raise NotShown
        return image

    def ball(self):
        """Return balls (k,) that contain the solution for all inputs in the box."""
        return self.linear_part + self.remainder

    def relative_parts(self):
        """Yield for each unknown z, Z / z, w / z and their sum e = (Z d + w) / z.

        The solution is z (1 + e).
        """
        for row, (z, w) in enumerate(zip(self.centre, self.remainder, strict=True)):
            relative_rates = self.rates[row] / z
            yield z, relative_rates, w / z, relative_rates @ self.steps + w / z

    def show_real(self):
        """Show that the solution is real: its mirror image 1 / conj z is the same solution.

        The equations are real, so the mirror image is a solution too. It lies in a box of
        twice the radius about z + Z d, in which there is only one solution. So both are the
        same, |z| is 1, and the angle is real. `NotShown` is raised if this is not shown.

        The solution is z (1 + e) with e = (Z d + w) / z. With s = 1 / (z conj z) and the
        conjugate c of e, the mirror image is z s / (1 + c) = z s (1 - c + c^2 / (1 + c)).
        Its difference from z + Z d is z times

            s - 1 - (s conj(Z / z) + Z / z) d + s (c^2 / (1 + c) - conj(w / z)),

        in which the linear terms nearly cancel if z is on the unit circle.
        """
        wide_radius = 2 * self.radius
        # Raises `NotShown` unless there is only one solution in the wide box.
        self.image(wide_radius)
        for z, relative_rates, relative_remainder, change in self.relative_parts():
            scale = 1 / (z * z.conjugate())
            conjugate = change.conjugate()
            mirrored_rates = np.array([rate.conjugate() for rate in relative_rates])
            linear_terms = (scale * mirrored_rates + relative_rates) @ self.steps
            other_terms = scale * (
                conjugate * conjugate / (1 + conjugate) - relative_remainder.conjugate()
            )
            difference = z * (scale - 1 - linear_terms + other_terms)
            if not largest([difference]) < wide_radius:
                raise NotShown

    def angles(self):
        """Return the angles of a real solution, as triples.

        A triple has the angle at the centre of the box, its rates by the inputs, and a
        bound of the remainder. The angle is the imaginary part of log(z (1 + e)), where e
        is the relative change in the box. log(1 + e) differs from e by at most
        |e|^2 / (2 (1 - |e|)).
        """
        angles = []
        for inverse, (z, relative_rates, relative_remainder, change) in zip(
            self.inverse, self.relative_parts(), strict=True
        ):
            sense = -1 if inverse else 1
            angle = sense * z.log().imag
            size = arb(abs(change).upper())
            if not size < 0.5:
                raise NotShown
            rates = [arb((sense * rate.imag).mid()) for rate in relative_rates]
            # The errors of the angle and of the rates at the centre are included.
            remainder = (
                abs(relative_remainder)
                + size**2 / (2 * (1 - size))
                + arb(angle.rad())
                + arb(1e-20)
            )
            angles.append((arb(angle.mid()), rates, arb(remainder.upper())))
        return angles


class NotShown(Exception):
    """What is tried is not proven over a box: it may be over its parts."""


def check_map(certificate):
    """Check a certificate that maps the number of modes over two inputs by boxes.

    The boxes must not overlap and must fill the ranges. Each says that it is regular, with
    a number of modes, or contains a type II singularity, or is undecided.

    The borders of boxes are rounded numbers, so boxes that overlap by less than 1e-9 rad
    count as apart.
    """
    ctx.prec = 80  # bits of all balls
    system = System(certificate)
    # A follower is a pair that wheels drive.
    need(system.follower is None, "maps with wheels are not checked")
    ranges = certificate["inputs"]
    ends = [[system.sizes.angle(end) for end in ranges[name]] for name in ranges]
    low, high = np.array(ends).T
    boxes = certificate["boxes"]
    centres = np.array([box["centre_rad"] for box in boxes])
    halves = np.array([box["half_rad"] for box in boxes])

    distances = np.abs(centres[:, None] - centres)
    is_apart = distances > halves[:, None] + halves - 1e-9
    is_same = np.eye(len(boxes), dtype=bool)
    need(np.all(np.any(is_apart, axis=2) | is_same), "two boxes overlap")
    need(np.all(halves > 0), "an empty box")
    need(np.all(ball(centres) - ball(halves) > low - 1e-9), "a box outside")
    need(np.all(ball(centres) + ball(halves) < high + 1e-9), "a box outside")

    relative_sizes = 2 * halves / mid(high - low).astype(float)
    areas = {}
    for box, area in zip(boxes, np.prod(relative_sizes, axis=1), strict=True):
        areas[box["is"]] = areas.get(box["is"], 0.0) + area
    need(abs(sum(areas.values()) - 1) < 1e-6, "boxes do not fill the ranges")
    for kind, share in certificate["shares"].items():
        need(abs(areas.get(kind, 0.0) - share) < 1e-6, "another share")

    mode_counter = ModeCounter(system, certificate["systems"])
    for box in boxes:
        if box["is"] == "regular":
            centre = ball(box["centre_rad"])
            check_regular(mode_counter, centre, box["half_rad"], box["modes"], depth=0)
        elif box["is"] == "contains type II":
            check_contains(mode_counter, box)
        else:
            need(box["is"] == "undecided", "a box of no kind")


def check_regular(mode_counter, centre, half_widths, modes, depth):
    """Check that a box has the same number of modes at all inputs.

    If this is not shown for the whole box, its four quarters are checked. `depth` is how
    many times the first box was halved to give this one.
    """
    mode_count = mode_counter.count_modes(centre, half_widths)
    if mode_count is not None:
        need(mode_count == modes, "another number of modes in a box")
        return
    need(depth < DEEPEST, "a box that is not shown to be regular")
    half_widths = np.array(half_widths) / 2
    for signs in product((-1, 1), repeat=2):
        quarter_centre = centre + ball(signs * half_widths)
        check_regular(mode_counter, quarter_centre, half_widths, modes, depth + 1)


def check_contains(mode_counter, box):
    """Check that a box contains a type II singularity.

    It does if there are different numbers of modes at two points of the box.
    """
    mode_counts = set()
    centre = np.array(box["centre_rad"])
    half_widths = np.array(box["half_rad"])
    for steps in (2, 4, 16):
        for grid in product(np.linspace(-0.999, 0.999, steps + 1), repeat=2):
            inputs = ball(centre + half_widths * grid)
            # None where the number is not shown.
            mode_counts.add(mode_counter.count_modes(inputs, [0.0, 0.0]))
            if len(mode_counts - {None}) > 1:
                return
    need(False, "a box that is not shown to have a singular configuration")
