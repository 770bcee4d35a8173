"""Checks counts of modes by subsystems, and maps of two inputs, without spherekit.

With e^(i angle) = a / b, a rotation times a b is a polynomial in a and b. A point is (z,
1), or (1, w) with the inverse w, so an angle at infinity is a solution like any other.

A subsystem is a part of the equations with its own unknowns, given the angles of earlier
subsystems. In certificates ("systems") it is a dictionary with the links of its equations,
its unknowns, and solutions at some angles ("solved") to start from. An equation is named by
the link that it places. `PolynomialEquations` (of `proof_checker`) evaluates the equations
of a subsystem and their derivatives, in a and b of its unknowns.

`arb` and `acb` are real and complex balls: numbers with rigorous bounds of their errors.
"""

from itertools import combinations, product

import numpy as np
from flint import acb, acb_poly, arb, ctx
from oracles.proof_checker import (
    PolynomialEquations,
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

MAX_HALVINGS = 7
"""Largest number of times that a box is halved to show that it is regular."""


def as_fraction(is_inverse, z):
    """Return numbers (a, b) with e^(i angle) = a / b.

    `z` is e^(i angle), or its inverse if `is_inverse` is true.
    """
    return (acb(1), z) if is_inverse else (z, acb(1))


def check_subsystems(system, subsystems):
    """Check that the subsystems contain every equation once and can be solved in order.

    The closure equations of a mechanism are divided into subsystems, which are solved one
    after another. The equations of a subsystem may contain its unknown angles, those of
    earlier subsystems, and the inputs.

    Parameters
    ----------
    system
        All equations of the mechanism: one for each link that closes a loop.
    subsystems
        The subsystems of the certificate (file of a proof), in their order.

    Returns
    -------
    bounds
        Largest number of solutions of each subsystem: the permanent of the degrees of its
        equations in its unknowns (multihomogeneous theorem of Bezout).
    table
        Degrees of each equation in all unknowns, by link.
    """
    table = dict(zip(system.closing_links(), system.degrees(), strict=True))
    remaining = dict(table)
    solved_unknowns = set()
    bounds = []
    for subsystem in subsystems:
        rows = [remaining.pop(link) for link in subsystem["equations"]]
        solved_unknowns |= set(subsystem["unknowns"])
        used = set()
        for row in rows:
            used |= {x for x, degree in zip(system.unknowns, row, strict=True) if degree}
        need(used <= solved_unknowns, "a system with unknowns of a later one")
        columns = [system.unknowns.index(name) for name in subsystem["unknowns"]]
        need(len(columns) == len(rows), "a system that is not square")
        bounds.append(permanent_of([[row[c] for c in columns] for row in rows]))
    is_everything = not remaining and solved_unknowns == set(system.unknowns)
    need(is_everything, "equations are missing")
    return bounds, table


def check_systems(system, certificate, driven):
    """Check that the number of real modes is the one that the certificate states."""
    ctx.prec = 80
    centre = [driven[name] for name in system.inputs]
    # A box without extent: the inputs themselves.
    half_widths = [0.0] * len(centre)
    mode_counter = ModeCounter(system, certificate["systems"])
    mode_count = mode_counter.count_modes(centre, half_widths)
    need(mode_count == certificate["modes"], "another number of modes by systems")


def roots_of(system, subsystem, driven):
    """Return approximations of all solutions of one equation in one unknown angle.

    The equation is a polynomial in z = e^(i angle). Its coefficients follow from its values
    at roots of unity (a discrete Fourier transform).

    Parameters
    ----------
    system
        All equations of the mechanism.
    subsystem
        The equation, its unknown, and its degree. The name of the equation is the link that
        closes a loop.
    driven
        Angles (rad) of the inputs and of the unknowns that are solved already, as balls
        (numbers with a rigorous error bound).

    Returns
    -------
    list of (is_inverse, [number])
        The number is z if |z| is at most 1. Otherwise `is_inverse` is [True], and the
        number is 1 / z.
    """
    (link,) = subsystem["equations"]
    (name,) = subsystem["unknowns"]
    # [False]: the unknown of the polynomial is z, and not 1 / z.
    polynomial_equation = PolynomialEquations(system, [link], [name], [False])
    count = subsystem["degree"] + 1
    roots_of_unity = [acb(0, 2 * arb.pi() * k / count).exp() for k in range(count)]
    # The middles of the given angles, without their errors.
    middle = {pair: arb(angle.mid()) for pair, angle in driven.items()}
    values = [polynomial_equation.values([z], middle)[0][0] for z in roots_of_unity]
    # Coefficient k is the mean of value / z^k. At roots of unity 1 / z^k = z^(count - k).
    coefficients = []
    for k in range(count):
        terms = [v * z ** (count - k) for v, z in zip(values, roots_of_unity, strict=True)]
        coefficients.append(sum(terms) / count)
    polynomial = acb_poly([acb(x.mid()) for x in coefficients])
    points = []
    # Few digits suffice: the roots are only centres of boxes, in which solutions are proven
    # later.
    for root in polynomial.roots(tol=1e-15):
        z = acb(root.mid())
        is_large = abs(complex(float(z.real), float(z.imag))) > 1
        number = acb((1 / z).mid()) if is_large else z
        points.append(([is_large], [number]))
    return points


MAX_ANGLE_STEP_RAD = 0.05
"""Largest change of a given angle in one step along which solutions are followed.

Larger: Newton's method may fail, or lead two solutions to the same one. The certificate is
then refused, not accepted wrongly. Smaller: the check takes longer.
"""


def follow_solutions(system, subsystem, driven):
    """Return approximations of all solutions of a subsystem at given angles.

    The certificate states all solutions at some choices of the given angles. From the
    nearest choice, the given angles move to the present ones in small steps. After each
    step Newton's method corrects every solution.

    Parameters
    ----------
    system
        All equations of the mechanism.
    subsystem
        The equations that are solved, as the certificate states them.
    driven
        Angles (balls, rad) of the inputs and of the unknowns that are solved already.

    Returns
    -------
    list of (is_inverse, z)
        z has for each unknown the complex number e^(i angle), or its inverse if
        `is_inverse` is true. A complex solution may have e^(i angle) infinite. Its inverse
        is then 0, an ordinary number.

    Raises
    ------
    Refused
        If the certificate states no solutions to start from.
    """
    need(subsystem["solved"], "a system without solutions to start from")
    middle = {pair: float(angle.mid()) for pair, angle in driven.items()}

    def gaps_to(stated):
        """Return by how much given angles differ from those of a stated choice."""
        given = stated["given"]
        pairs = [pair for pair in subsystem["used"] if pair in given]
        return {pair: wrapped(middle[pair] - given[pair]) for pair in pairs}

    start = min(subsystem["solved"], key=lambda x: max(map(abs, gaps_to(x).values())))
    gaps = gaps_to(start)
    step_count = 1 + int(max(map(abs, gaps.values())) / MAX_ANGLE_STEP_RAD)
    points = []
    for solution in start["solutions"]:
        is_inverse = list(solution["inverse"])
        z = [acb(real, imaginary) for real, imaginary in solution["z"]]
        for step in range(1, step_count + 1):
            remaining = 1 - step / step_count
            # Angles without a gap are not in these equations, so their value has no effect.
            angles = {
                pair: arb(angle - gaps.get(pair, 0.0) * remaining)
                for pair, angle in middle.items()
            }
            for column, value in enumerate(z):
                # A number beyond 2 is replaced by its inverse, below 1/2. So a number near
                # the unit circle is not inverted again and again.
                if abs(value) > 2:
                    is_inverse[column] = not is_inverse[column]
                    z[column] = (1 / value).mid()
            equations = PolynomialEquations(
                system, subsystem["equations"], subsystem["unknowns"], is_inverse
            )
            # Too few Newton steps would be noticed: `SolutionOverBox` then proves nothing.
            for _ in range(4):
                value, slope = equations.values(z, angles)
                z = list(mid(np.array(z) - inverse_near(slope) @ mid(value)))
        points.append((is_inverse, z))
    return points


class ModeCounter:
    """Counts the assembly modes over boxes of the inputs, subsystem by subsystem.

    An assembly mode is one of the ways to assemble the mechanism: a real solution.
    """

    def __init__(self, system, subsystems):
        """Check the subsystems, and store their degrees and the angles in them (`used`)."""
        self.system = system
        self.subsystems = subsystems
        bounds, table = check_subsystems(system, subsystems)
        for subsystem, bound in zip(subsystems, bounds, strict=True):
            subsystem["degree"] = bound
            rows_of = [table[link] for link in subsystem["equations"]]
            columns = zip(system.unknowns, *rows_of, strict=True)
            used_unknowns = {name for name, *row in columns if any(row)}
            subsystem["used"] = used_unknowns | set(system.inputs)

    def count_modes(self, centre, half_widths):
        """Return the number of modes in a box if it is proven to be constant, else None.

        Modes are the real solutions of the closure equations, over a box of input angles.
        The equations consist of subsystems, which are solved one after another. All complex
        solutions of a subsystem are enclosed over the whole box and shown to be different.
        So none of them vanishes, and a real one stays real. Later subsystems are solved
        once for each real solution.

        Parameters
        ----------
        centre, half_widths
            Centre and half widths (inputs,) of the box, rad.
        """
        # Each angle is a triple: its value at the centre of the box, its rates by the
        # inputs, and a bound of the remainder.
        input_angles = {}
        input_count = len(centre)
        for k, (name, middle) in enumerate(zip(self.system.inputs, centre, strict=True)):
            rates = [int(k == j) for j in range(input_count)]
            input_angles[name] = (arb(middle), rates, arb(0))
        partial_solutions = [input_angles]
        try:
            for subsystem in self.subsystems:
                extended_solutions = []
                for known_angles in partial_solutions:
                    for angles in self._solve(subsystem, known_angles, half_widths):
                        unknowns = dict(zip(subsystem["unknowns"], angles, strict=True))
                        extended_solutions.append({**known_angles, **unknowns})
                partial_solutions = extended_solutions
        # Not enclosed, or perhaps equal (`NotShown`), or zero in a ball where it must not
        # be.
        except (NotShown, ZeroDivisionError, ValueError):
            return None
        return len(partial_solutions)

    def _solve(self, subsystem, known_angles, half_widths):
        """Return the angles of all real solutions of a subsystem over a box of inputs.

        A subsystem is some of the closure equations, with their unknown angles. All its
        complex solutions are enclosed and shown to be different. Their number must be the
        largest number that the degrees of the equations allow, so that none can be missing.

        Parameters
        ----------
        subsystem
            The equations that are solved, and their unknowns.
        known_angles
            Inputs and unknowns of earlier subsystems by name. Each is a triple: its value
            at the centre of the box, its rates by the inputs, and a bound of the remainder.
        half_widths
            Half widths (inputs,) of the box, rad.

        Returns
        -------
        For each real solution a list with a triple for each unknown.

        Raises
        ------
        NotShown
            If a solution is missing, is not enclosed, or may be equal to another one, or if
            it remains open whether it is real.
        """
        has_one_unknown = len(subsystem["unknowns"]) == 1
        middle = {name: angle for name, (angle, _, _) in known_angles.items()}
        find_points = roots_of if has_one_unknown else follow_solutions
        points = find_points(self.system, subsystem, middle)
        if len(points) != subsystem["degree"]:
            raise NotShown
        real_solutions = []
        fractions = []
        # The numbers of a point are e^(i angle) of the unknowns, or their inverses.
        for is_inverse, centre in points:
            solution = SolutionOverBox(
                self.system, subsystem, known_angles, half_widths, is_inverse, centre
            )
            enclosure = solution.ball()
            # The numbers (a, b) with e^(i angle) = a / b, for each unknown.
            fractions.append(
                [as_fraction(i, z) for i, z in zip(is_inverse, enclosure, strict=True)]
            )
            # An angle is real if |e^(i angle)| is 1.
            may_be_real = all(abs(z).contains(1) for z in enclosure)
            if may_be_real:
                solution.show_real()
                real_solutions.append(solution.angles())
        for first, second in combinations(fractions, 2):
            # Two fractions a / b and c / d are equal if a d = b c.
            pairs = zip(first, second, strict=True)
            if all((a * d - b * c).contains(0) for (a, b), (c, d) in pairs):
                raise NotShown
        return real_solutions


class SolutionOverBox:
    """One solution of a subsystem over a box of inputs: z + Z d + w.

    d are the inputs less the centre of the box. z is the solution at the centre, Z d its
    linear part, and w a remainder, which is bounded for all d at once by Krawczyk's
    operator. The components are e^(i angle) of the unknowns, or their inverses.

    Attributes
    ----------
    centre, rates
        (k,) z, and (k, inputs) Z.
    input_changes
        (inputs,) balls that contain all d.
    given
        By name: balls of the known angles over the box.
    preconditioner
        (k, k) Y, near the inverse of the derivatives by the unknowns at the centre.
    linear_part
        (k,) balls that contain all z + Z d.
    image_of_zero
        (k,) balls that contain -Y P at all z + Z d, with the equations P = 0.
    radius
        Bound of the real and the imaginary part of each component of w.
    remainder
        (k,) balls that contain all w.
    """

    def __init__(self, system, subsystem, known_angles, half_widths, is_inverse, centre):
        """Enclose one solution of a subsystem over a box of inputs, or raise `NotShown`.

        Let d be the inputs less the centre of the box. The solution is z + Z d + w: its
        value z at the centre, a linear part with the rates Z, and a remainder w.

        Parameters
        ----------
        system, subsystem
            All equations of the mechanism, and those that are solved.
        known_angles
            Inputs and unknowns of earlier subsystems by name. Each is a triple: its value
            at the centre of the box, its rates by the inputs, and a bound of the remainder.
        half_widths
            Half widths (inputs,) of the box, rad.
        is_inverse, centre
            Approximation z (k,) of the solution at the centre of the box. A component is
            e^(i angle) of an unknown, or its inverse if `is_inverse` is true.
        """
        self.is_inverse = is_inverse
        self.centre = np.array(centre)
        names = list(known_angles)
        count = len(centre)
        # Derivatives of the equations are by the k unknowns first, then by known angles.
        self.equations = PolynomialEquations(
            system, subsystem["equations"], subsystem["unknowns"], is_inverse, names
        )
        # Balls (numbers with error bounds) that contain all d.
        self.input_changes = about(half_widths)
        self.identity = ball(np.eye(count))

        # The known angles at the centre, and over the whole box.
        middle = {name: known_angles[name][0] for name in names}
        rates_of_given = ball([known_angles[name][1] for name in names])
        remainder_of_given = about([known_angles[name][2] for name in names])
        change_of_given = rates_of_given @ self.input_changes + remainder_of_given
        self.given = {
            name: middle[name] + change
            for name, change in zip(names, change_of_given, strict=True)
        }

        # The derivative of the equations along the solution is zero. At the centre this is
        # slope_by_unknowns Z + slope_by_given rates_of_given = 0, which gives Z.
        value, slope = self.equations.values(centre, middle)
        self.preconditioner = inverse_near(slope[:, :count])
        self.rates = mid(-self.preconditioner @ (slope[:, count:] @ rates_of_given))
        self.linear_part = self.centre + self.rates @ self.input_changes

        # The equations at all z + Z d, by the mean value theorem: the value at the centre,
        # plus the derivatives over the box times the changes of unknowns and known angles.
        _, slope = self.equations.values(self.linear_part, self.given)
        slope_by_unknowns = slope[:, :count]
        slope_by_given = slope[:, count:]
        slope_by_inputs = slope_by_unknowns @ self.rates + slope_by_given @ rates_of_given
        linear_change = slope_by_inputs @ self.input_changes
        self.image_of_zero = -self.preconditioner @ (
            value + linear_change + slope_by_given @ remainder_of_given
        )
        # Krawczyk's operator maps w = 0 to `image_of_zero`, so w is about as large. A
        # slightly larger radius is tried; the constant keeps it above zero. `image` raises
        # `NotShown` unless the operator maps all w of this radius to smaller ones.
        self.radius = 1.5 * largest(self.image_of_zero) + arb(1e-14)
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
        image = self.image_of_zero + contraction @ around
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
            change = relative_rates @ self.input_changes + w / z
            yield z, relative_rates, w / z, change

    def show_real(self):
        """Show that the angles of the solution are real, or raise `NotShown`.

        The solution is x = e^(i angle) for each unknown. An angle is real if x is on the
        unit circle, where x equals its mirror image 1 / conj(x). The equations are real, so
        the mirror image of a solution is a solution too. Both are the same solution if they
        lie in a box that contains only one.

        Over a box of inputs with the changes d, x = z + Z d + w: z is the value at the
        centre, Z its rates, and w a bounded remainder. The box of solutions is around z +
        Z d. Half its side is twice the radius that bounds w, so that it contains x.
        """
        half_side = 2 * self.radius
        # Krawczyk's operator raises `NotShown` unless the box has only one solution.
        self.image(half_side)
        for z, rates, w in zip(self.centre, self.rates, self.remainder, strict=True):
            # The box has the centre z + Z d, from which its half side is measured.
            distance_from_centre = self._mirror_image_from_linear_part(z, rates, w)
            is_in_box = largest([distance_from_centre]) < half_side
            if not is_in_box:
                raise NotShown

    def _mirror_image_from_linear_part(self, z, rates, w):
        """Return a ball of the mirror image 1 / conj(x) less z + Z d, for one unknown x.

        The angle of x is real if x and its mirror image in the unit circle are the same.
        `show_real` concludes this if the image is in the box with one solution that has the
        centre z + Z d. A ball is a number with a rigorous error bound.

        The solution over a box of inputs is x = z + Z d + w, with the value z at the
        centre, the rates Z, the real changes d of the inputs, and a remainder w. With e =
        (Z d + w) / z, c = conj(e) and s = 1 / (z conj(z)), x = z (1 + e), and its mirror
        image is

            1 / conj(x) = z s / (1 + c) = z s (1 - c + c^2 / (1 + c)).

        With c = conj(Z / z) d + conj(w / z), as d is real, the difference from z + Z d is z
        times

            s - 1 - (s conj(Z / z) + Z / z) d + s (c^2 / (1 + c) - conj(w / z)).

        Parameters
        ----------
        z
            Solution at the centre of the box of inputs.
        rates
            (inputs,) the rates Z.
        w
            Ball of the remainder.
        """
        relative_rates = rates / z
        relative_remainder = w / z
        e = relative_rates @ self.input_changes + relative_remainder
        s = 1 / (z * z.conjugate())
        c = e.conjugate()
        conjugate_rates = np.array([rate.conjugate() for rate in relative_rates])
        # These terms nearly cancel on the unit circle. Their sum is formed before the
        # product with the balls d, because the radii of balls would add up.
        linear_terms = (s * conjugate_rates + relative_rates) @ self.input_changes
        other_terms = s * (c * c / (1 + c) - relative_remainder.conjugate())
        return z * (s - 1 - linear_terms + other_terms)

    def angles(self):
        """Return the angles of a solution with real angles over a box of inputs.

        Each angle is a triple: its value at the centre of the box, its rates by the inputs,
        and a bound of the remainder. `NotShown` is raised if the solution varies so much
        over the box that the bound would be useless (|e| of 0.5 or more, see below).

        The solution is e^(i angle) = z + Z d + w = z (1 + e) with e = (Z d + w) / z. Here d
        are the inputs less the centre of the box, z is the solution at this centre, Z are
        its rates, and w is a remainder. The angle is the imaginary part of log z + log(1 +
        e). log(1 + e) differs from e by at most |e|^2 / (2 (1 - |e|)). For some unknowns
        (`is_inverse`) the solution is e^(-i angle) instead.
        """
        angles = []
        for is_inverse, parts in zip(self.is_inverse, self.relative_parts(), strict=True):
            # Z / z and w / z are the relative rates and the relative remainder.
            z, relative_rates, relative_remainder, e = parts
            # An inverse unknown is e^(-i angle), so it gives the negative angle.
            sign = -1 if is_inverse else 1
            angle = sign * z.log().imag
            size = arb(abs(e).upper())
            if not size < 0.5:
                raise NotShown
            rates = [arb((sign * rate.imag).mid()) for rate in relative_rates]
            error_of_logarithm = size**2 / (2 * (1 - size))
            error_at_centre = arb(angle.rad())
            # The rates are the middles of balls. Their radii are roundings to 80 bits,
            # about 1e-24 of the rates. Times d, the errors are far below this.
            error_of_rates = arb(1e-20)
            remainder = (
                abs(relative_remainder)
                + error_of_logarithm
                + error_at_centre
                + error_of_rates
            )
            angles.append((arb(angle.mid()), rates, arb(remainder.upper())))
        return angles


class NotShown(Exception):
    """A statement could not be proven over a box, but perhaps over parts of the box."""


def check_map(certificate):
    """Check a certificate that maps the number of assembly modes over two inputs by boxes.

    A certificate is the file of a proof. The boxes must not overlap and must fill the
    ranges of the inputs. Each box says that it is regular, with a number of modes, or
    contains a type II singularity, or is undecided. The stated share of each kind must be
    that of its boxes in the area of the ranges. Small overlaps (1e-9 rad) and areas (1e-6)
    are not noticed, because the borders of boxes are rounded.
    """
    ctx.prec = 80  # bits of all balls
    system = System(certificate)
    # A follower is a pair that turns with an input through two wheels in mesh.
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

    # The certificate divides the closure equations into systems, solved in order.
    mode_counter = ModeCounter(system, certificate["systems"])
    for box in boxes:
        if box["is"] == "regular":
            centre = ball(box["centre_rad"])
            check_regular(mode_counter, centre, box["half_rad"], box["modes"])
        elif box["is"] == "contains type II":
            check_contains(mode_counter, box)
        else:
            need(box["is"] == "undecided", "a box of no kind")


def check_regular(mode_counter, centre, half_widths, stated_count, halvings=0):
    """Check that a box of two inputs has the stated number of assembly modes everywhere.

    If this is not shown for the whole box, its four quarters are checked.

    Parameters
    ----------
    mode_counter
        Counts the modes over a box if their number is proven to be constant.
    centre, half_widths
        Centre (balls) and half widths (2,) of the box, rad.
    stated_count
        Number of modes that the certificate states.
    halvings
        How many times the box of the certificate was halved to give this one.
    """
    mode_count = mode_counter.count_modes(centre, half_widths)
    if mode_count is not None:
        need(mode_count == stated_count, "another number of modes in a box")
        return
    need(halvings < MAX_HALVINGS, "a box that is not shown to be regular")
    half_widths = np.array(half_widths) / 2
    for signs in product((-1, 1), repeat=2):
        quarter_centre = centre + ball(signs * half_widths)
        check_regular(mode_counter, quarter_centre, half_widths, stated_count, halvings + 1)


def check_contains(mode_counter, box):
    """Check that a box of two inputs contains a type II singularity.

    Assembly modes (ways to assemble the links) can appear or vanish only at singularities
    of type II. So there is one in the box if the number of modes differs between two of its
    points. The modes are counted at points of finer and finer grids, just inside the
    borders of the box.
    """
    mode_counts = set()
    centre = np.array(box["centre_rad"])
    half_widths = np.array(box["half_rad"])
    # A point is a box without extent.
    no_half_widths = [0.0, 0.0]
    for steps in (2, 4, 16):
        for grid in product(np.linspace(-0.999, 0.999, steps + 1), repeat=2):
            inputs = ball(centre + half_widths * grid)
            # `count_modes` returns None if it cannot prove the number.
            mode_counts.add(mode_counter.count_modes(inputs, no_half_widths))
            if len(mode_counts - {None}) > 1:
                return
    need(False, "a box that is not shown to have a singular configuration")
