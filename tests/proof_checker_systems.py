"""Checks modes counted system by system, and maps of two inputs, without spherekit.

In e^(i angle) = a / b a rotation times a b is a polynomial in a and b, which are the
points (z, 1) and (1, w): so an angle at infinity is a solution like others.
"""

from itertools import combinations

from flint import acb, acb_poly, arb, ctx
from proof_checker import Dual, System, alone, cross, dot, need, permanent_of, rows, vector

WIDE = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
NARROW = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
DEEPEST = 7
PERIOD = 6.283185307179586


class Half:
    """Equations of links, polynomials in the e^(i angle) of pairs or in their inverses.

    Derivatives are by these, and then by the pairs `moving`.
    """

    def __init__(self, system, links, unknowns, inverse, moving=()):
        self.system, self.links, self.inverse = system, links, inverse
        self.unknowns, self.moving = unknowns, list(moving)
        self.count = len(unknowns) + len(self.moving)
        self.steps = {step["link"]: step for step in system.made["steps"]}

    def values(self, centre, driven):
        """P and its derivatives at balls of the points and of all other angles."""
        self.points = dict(zip(self.unknowns, centre, strict=True))
        self.driven, self.done = driven, {}
        found = [self._put(link)[0] for link in self.links]
        value = rows([[f.value[0, 0]] for f in found])
        slope = rows([[s[0, 0] for s in f.slopes] for f in found])
        return value, slope

    def _constant(self, matrix):
        return Dual(matrix, [0 * matrix for _ in range(self.count)])

    def _local(self, link):
        """The matrix of a link in the one before, times its scale, and the scale."""
        if link not in self.done:
            across = len(self.steps[link]["by"]) == 1
            self.done[link] = self._turned(link) if across else self._put(link)[1:]
        return self.done[link]

    def _turned(self, link):
        step = self.steps[link]
        (pair,), (parent,) = step["by"], step["on"]
        sense = 1 if self.system.sizes.ends[pair][0] == parent else -1
        before = self._constant(self.system.frames[pair, parent])
        after = self._constant(self.system.frames[pair, link].transpose())
        slopes = [rows([[0] * 3] * 3) for _ in range(self.count)]
        scale = self._constant(rows([[1]]))
        if pair in self.points:
            column = self.unknowns.index(pair)
            z = self.points[pair]
            one = acb(1)
            a, b, up, down = (one, z, 0, one) if self.inverse[column] else (z, one, one, 0)
            c, s, w = (a * a + b * b) / 2, (a * a - b * b) / acb(0, 2), a * b
            dc, ds, dw = (
                a * up + b * down,
                (a * up - b * down) / acb(0, 1),
                a * down + up * b,
            )
            slopes[column] = rows([[dc, -sense * ds, 0], [sense * ds, dc, 0], [0, 0, dw]])
            scale.value = rows([[w]])
            scale.slopes[column] = rows([[dw]])
        else:
            s, c = acb(self.driven[pair]).sin_cos()
            w = acb(1)
            if pair in self.moving:
                column = len(self.unknowns) + self.moving.index(pair)
                slopes[column] = rows([[-s, -sense * c, 0], [sense * c, -s, 0], [0, 0, 0]])
        turn = Dual(rows([[c, -sense * s, 0], [sense * s, c, 0], [0, 0, w]]), slopes)
        return before @ turn @ after, scale

    def _way(self, link):
        step = self.steps.get(link)
        if step is None:
            return []
        if len(step["by"]) == 1:
            return [*self._way(step["on"][0]), link]
        return [*self._parted(*step["on"])[0], link]

    def _parted(self, one, other):
        one, other, shared = self._way(one), self._way(other), []
        while one and other and one[0] == other[0]:
            shared.append(one.pop(0))
            other.pop(0)
        return shared, one, other

    def _put(self, link):
        """The equation of a link put on two axes, its matrix times its scale, the scale."""
        step = self.steps[link]
        _, *ways = self._parted(*step["on"])
        own = [[self.system.frames[p, link][k, 2] for k in range(3)] for p in step["by"]]
        axes, scales = [], []
        for way, pair, parent in zip(ways, step["by"], step["on"], strict=True):
            frame = self.system.frames[pair, parent]
            axis = self._constant(vector([frame[k, 2] for k in range(3)]))
            scale = self._constant(rows([[1]]))
            for each in reversed(way):
                matrix, size = self._local(each)
                axis, scale = matrix @ axis, scale @ size
            axes.append(axis)
            scales.append(scale)
        both = scales[0] @ scales[1]
        miss = axes[0].T @ axes[1] + both @ self._constant(rows([[-dot(*own)]]))
        normal = cross(*own)
        need(dot(normal, normal).real > 0, f"the arc of {link} may be 0 or 180 degrees")
        inverse = rows([own[0], own[1], normal]).transpose().inv()
        third = System.crossed(*axes)
        columns = [axes[0] @ scales[1], axes[1] @ scales[0], third]
        parts = [
            each @ self._constant(rows([[inverse[k, j] for j in range(3)]]))
            for k, each in enumerate(columns)
        ]
        return miss, parts[0] + parts[1] + parts[2], both


def plain(inverse, z):
    """The pair (a, b) of a point."""
    return (acb(1), z) if inverse else (z, acb(1))


def square(z, radius):
    return z + acb(arb(0, radius), arb(0, radius))


class Solved:
    """All solutions of one system, proven: those that are real are angles."""

    def __init__(self, system, part, driven, points, bound):
        need(len(points) == bound, "not as many solutions as there can be")
        self.real, balls = [], []
        for inverse, centre in points:
            half = Half(system, part["equations"], part["unknowns"], inverse)
            small = next((r for r in NARROW if proven(half, centre, r, driven)), None)
            need(small is not None, "a solution of a system is not shown")
            within = [square(z, small) for z in centre]
            balls.append([plain(i, z) for i, z in zip(inverse, within, strict=True)])
            if any(not abs(z).contains(1) for z in within):
                continue
            large = next(r for r in (*WIDE, small) if proven(half, centre, r, driven))
            for z, c in zip(within, centre, strict=True):
                gap = 1 / z.conjugate() - c
                fits = max(abs(gap.real).upper(), abs(gap.imag).upper()) < arb(large)
                need(fits, "a solution that may be real or not")
            self.real.append(
                [
                    (-z.log().imag if i else z.log().imag)
                    for i, z in zip(inverse, within, strict=True)
                ]
            )
        for one, other in combinations(balls, 2):
            apart = any(
                not (a * d - b * c).contains(0)
                for (a, b), (c, d) in zip(one, other, strict=True)
            )
            need(apart, "two solutions may be one")


def proven(half, centre, radius, driven):
    try:
        return alone(half, centre, radius, driven)
    except ZeroDivisionError:
        return False


def check_parts(system, parts):
    """The degrees of each system's equations: all are in one, with what is known before."""
    table = dict(zip((step["link"] for step in system.onto), system.degrees(), strict=True))
    known, left, bounds = set(), dict(table), []
    for part in parts:
        own = [left.pop(link) for link in part["equations"]]
        known |= set(part["unknowns"])
        used = {n for row in own for n, d in zip(system.unknowns, row, strict=True) if d}
        need(used <= known, "a system with unknowns of a later one")
        columns = [system.unknowns.index(name) for name in part["unknowns"]]
        need(len(columns) == len(own), "a system that is not square")
        bounds.append(permanent_of([[row[c] for c in columns] for row in own]))
    need(not left and known == set(system.unknowns), "equations are missing")
    return bounds, table


def check_systems(system, certificate, driven):
    """Show that there are as many real modes as roots are given."""
    ctx.prec = 80
    parts = certificate["systems"]
    bounds, table = check_parts(system, parts)
    paths = [dict(driven)]
    for part, bound in zip(parts, bounds, strict=True):
        used = {
            name
            for link in part["equations"]
            for name, degree in zip(system.unknowns, table[link], strict=True)
            if degree and name not in part["unknowns"]
        }
        following = []
        for path in paths:
            points = next(
                (each for each in part["solved"] if near(each["given"], path, used)), None
            )
            need(points is not None, "a system that is not solved for a mode")
            tried = [
                (each["inverse"], [acb(*z) for z in each["z"]])
                for each in points["solutions"]
            ]
            for angles in Solved(system, part, path, tried, bound).real:
                own = zip(part["unknowns"], angles, strict=True)
                following.append({**path, **dict(own)})
        paths = following
    need(len(paths) == certificate["modes"], "another number of modes by systems")


def near(given, path, used):
    for name in used:
        gap = float(path[name].mid()) - given[name]
        if abs((gap + PERIOD / 2) % PERIOD - PERIOD / 2) > 1e-6:
            return False
    return True


def roots_of(system, part, driven):
    """Approximations of all solutions of one equation in one unknown."""
    ((link,), (name,)) = part["equations"], part["unknowns"]
    half = Half(system, [link], [name], [False])
    size = part["degree"] + 1
    turns = [acb(0, 2 * arb.pi() * k / size).exp() for k in range(size)]
    middle = {pair: arb(angle.mid()) for pair, angle in driven.items()}
    values = [half.values([z], middle)[0][0, 0] for z in turns]
    made = [
        sum(v * z ** (size - k) for v, z in zip(values, turns, strict=True)) / size
        for k in range(size)
    ]
    found = acb_poly([acb(each.mid()) for each in made]).roots(tol=1e-15)
    points = []
    for root in found:
        z = acb(root.mid())
        big = abs(complex(float(z.real), float(z.imag))) > 1
        points.append(([big], [acb((1 / z).mid()) if big else z]))
    return points


STEP = 0.05
"""How far (rad) given angles go at once where solutions are followed."""


def followed(system, part, driven):
    """Approximations of all solutions of a system, followed from the nearest given."""
    need(part["solved"], "a system without solutions to start from")
    middle = {pair: float(angle.mid()) for pair, angle in driven.items()}

    def gaps(given):
        return {
            pair: (angle - given[pair] + PERIOD / 2) % PERIOD - PERIOD / 2
            for pair, angle in middle.items()
            if pair in given and pair in part["used"]
        }

    start = min(
        part["solved"], key=lambda each: max(map(abs, gaps(each["given"]).values()))
    )
    apart = gaps(start["given"])
    steps = 1 + int(max(map(abs, apart.values())) / STEP)
    points = []
    for solution in start["solutions"]:
        inverse, z = list(solution["inverse"]), [acb(*each) for each in solution["z"]]
        for step in range(1, steps + 1):
            place = {
                pair: arb(angle - apart.get(pair, 0.0) * (1 - step / steps))
                for pair, angle in middle.items()
            }
            for column, each in enumerate(z):
                if abs(each) > 2:
                    inverse[column], z[column] = not inverse[column], (1 / each).mid()
            half = Half(system, part["equations"], part["unknowns"], inverse)
            for _ in range(4):
                value, slope = half.values(z, place)
                change = slope.mid().solve(value.mid()).entries()
                z = [(a - b).mid() for a, b in zip(z, change, strict=True)]
        points.append((inverse, z))
    return points


class Counting:
    """The number of modes over boxes of the inputs, system by system."""

    def __init__(self, system, parts):
        self.system, self.parts = system, parts
        bounds, table = check_parts(system, parts)
        for part, bound in zip(parts, bounds, strict=True):
            part["degree"] = bound
            rows_of = [table[link] for link in part["equations"]]
            columns = zip(system.unknowns, *rows_of, strict=True)
            part["used"] = {name for name, *row in columns if any(row)} | set(system.inputs)

    def at(self, place, half):
        """The number of modes if it is proven to be the same in a box, else None.

        Every angle is a number, its rates by the inputs, and how much more it varies.
        """
        count = len(place)
        names = self.system.inputs
        path = {
            name: (arb(middle), [int(k == d) for k in range(count)], arb(0))
            for d, (name, middle) in enumerate(zip(names, place, strict=True))
        }
        paths = [path]
        try:
            for part in self.parts:
                paths = [
                    {**path, **dict(zip(part["unknowns"], angles, strict=True))}
                    for path in paths
                    for angles in self._solved(part, path, half)
                ]
        except (NotShown, ZeroDivisionError, ValueError):
            return None
        return len(paths)

    def _solved(self, part, path, half):
        """The angles of all real solutions, where there are as many as there can be."""
        alone = len(part["unknowns"]) == 1
        middle = {name: angle for name, (angle, _, _) in path.items()}
        points = (roots_of if alone else followed)(self.system, part, middle)
        if len(points) != part["degree"]:
            raise NotShown
        real, balls = [], []
        for inverse, centre in points:
            axis = Axis(self.system, part, path, half, inverse, centre)
            within = axis.ball()
            balls.append([plain(i, z) for i, z in zip(inverse, within, strict=True)])
            if all(abs(z).contains(1) for z in within):
                axis.need_real()
                real.append(axis.angles())
        for one, other in combinations(balls, 2):
            pairs = zip(one, other, strict=True)
            if all((a * d - b * c).contains(0) for (a, b), (c, d) in pairs):
                raise NotShown
        return real


def largest(entries):
    return max(abs(part).upper() for e in entries for part in (e.real, e.imag))


class Axis:
    """One solution over a box of inputs: z + Z d + w, with d from the box's centre.

    Krawczyk's operator is used about z + Z d for all d at once; w is what it finds.
    """

    def __init__(self, system, part, path, half, inverse, centre):
        self.inverse, self.centre, moving = inverse, centre, list(path)
        self.half = Half(system, part["equations"], part["unknowns"], inverse, moving)
        self.steps = [arb(0, h) for h in half]
        count = len(centre)
        rates = rows([path[name][1] for name in moving])
        more = vector([arb(0, path[name][2]) for name in moving])
        middle = {name: path[name][0] for name in moving}
        turned = (rates * vector(self.steps) + more).entries()
        self.given = {n: middle[n] + t.real for n, t in zip(moving, turned, strict=True)}
        value, slope = self.half.values(centre, middle)
        inner, outer = parted(slope, count)
        self.pull = inner.mid().inv().mid()
        self.rates = (-1 * (self.pull * (outer * rates))).mid()
        ahead = (self.rates * vector(self.steps)).entries()
        self.along = [c + a for c, a in zip(centre, ahead, strict=True)]
        inner, outer = parted(self.half.values(self.along, self.given)[1], count)
        change = (inner * self.rates + outer * rates) * vector(self.steps)
        self.start = -1 * (self.pull * (value + change + outer * more))
        self.radius = 1.5 * largest(self.start.entries()) + arb(1e-14)
        self.rest = self.image(self.radius)

    def image(self, radius):
        """What the operator makes of all w of a radius, within that."""
        around = acb(arb(0, radius), arb(0, radius))
        count = len(self.centre)
        _, slope = self.half.values([z + around for z in self.along], self.given)
        inner, _ = parted(slope, count)
        one = rows([[int(r == c) for c in range(count)] for r in range(count)])
        moved = self.start + (one - self.pull * inner) * vector([around] * count)
        if not largest(moved.entries()) < radius:
            raise NotShown
        return moved.entries()

    def ball(self):
        return [a + w for a, w in zip(self.along, self.rest, strict=True)]

    def parts(self):
        """Of each angle z, Z / z, w / z and (Z d + w) / z."""
        for row, (z, w) in enumerate(zip(self.centre, self.rest, strict=True)):
            bent = [self.rates[row, d] / z for d in range(len(self.steps))]
            yield z, bent, w / z, dot(bent, self.steps) + w / z

    def need_real(self):
        """Show that the mirror image 1 / conj z of the solution is that solution."""
        wide = 2 * self.radius
        self.image(wide)
        for z, bent, rest, moved in self.parts():
            size = 1 / (z * z.conjugate())
            back = moved.conjugate()
            first = sum(
                (size * k.conjugate() + k) * d
                for k, d in zip(bent, self.steps, strict=True)
            )
            far = size * (back * back / (1 + back) - rest.conjugate())
            if not largest([z * (size - 1 - first + far)]) < wide:
                raise NotShown

    def angles(self):
        """The angles of a real solution, their rates, and how much more they vary."""
        made = []
        for inverse, (z, bent, rest, moved) in zip(self.inverse, self.parts(), strict=True):
            sense = -1 if inverse else 1
            angle, size = sense * z.log().imag, arb(abs(moved).upper())
            if not size < 0.5:
                raise NotShown
            rates = [arb((sense * k.imag).mid()) for k in bent]
            more = abs(rest) + size**2 / (2 * (1 - size)) + arb(angle.rad()) + arb(1e-20)
            made.append((arb(angle.mid()), rates, arb(more.upper())))
        return made


def parted(slope, count):
    """The derivatives by the unknowns, and those by all other angles."""
    table = slope.tolist()
    return rows([row[:count] for row in table]), rows([row[count:] for row in table])


class NotShown(Exception):
    """What is tried is not proven over a box: it may be over its parts."""


def check_map(certificate):
    """Show what is said of each box of two inputs, and that they fill their ranges."""
    ctx.prec = 80
    system = System(certificate)
    need(system.follower is None, "maps with wheels are not checked")
    names = list(certificate["inputs"])
    ends = [[system.sizes.angle(e) for e in certificate["inputs"][n]] for n in names]
    boxes = certificate["boxes"]
    for one, other in combinations(boxes, 2):
        gaps = zip(one["centre_rad"], other["centre_rad"], strict=True)
        sums = zip(one["half_rad"], other["half_rad"], strict=True)
        apart = any(
            abs(a - b) > r + s - 1e-9 for (a, b), (r, s) in zip(gaps, sums, strict=True)
        )
        need(apart, "two boxes overlap")
    whole, areas = 1.0, {}
    for low, high in ends:
        whole *= float((high - low).mid())
    for box in boxes:
        for (low, high), c, r in zip(ends, box["centre_rad"], box["half_rad"], strict=True):
            need(r > 0, "an empty box")
            need(arb(c) - r > low - 1e-9 and arb(c) + r < high + 1e-9, "a box outside")
        (r, s) = box["half_rad"]
        areas[box["is"]] = areas.get(box["is"], 0.0) + 4 * r * s / whole
    need(abs(sum(areas.values()) - 1) < 1e-6, "boxes do not fill the ranges")
    for words, share in certificate["shares"].items():
        need(abs(areas.get(words, 0.0) - share) < 1e-6, "another share")
    counting = Counting(system, certificate["systems"])
    for box in boxes:
        place = [arb(c) for c in box["centre_rad"]]
        if box["is"] == "regular":
            check_regular(counting, place, box["half_rad"], box["modes"], 0)
        elif box["is"] == "contains type II":
            check_contains(counting, box)
        else:
            need(box["is"] == "undecided", "a box of no kind")


def check_regular(counting, place, half, modes, depth):
    found = counting.at(place, half)
    if found is not None:
        need(found == modes, "another number of modes in a box")
        return
    need(depth < DEEPEST, "a box that is not shown to be regular")
    for signs in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        parts = zip(place, half, signs, strict=True)
        middle = [c + arb(s * r) / 2 for c, r, s in parts]
        check_regular(counting, middle, [r / 2 for r in half], modes, depth + 1)


def check_contains(counting, box):
    seen = set()
    for steps in (2, 4, 16):
        for j in range(steps + 1):
            for k in range(steps + 1):
                parts = zip(box["centre_rad"], box["half_rad"], (j, k), strict=True)
                place = [arb(c + r * 0.999 * (2 * n / steps - 1)) for c, r, n in parts]
                seen.add(counting.at(place, [0.0, 0.0]))
                if len(seen - {None}) > 1:
                    return
    need(False, "a box that is not shown to have a singular configuration")
