"""Check certificates of armgpi in exact arithmetic, with the standard library alone.

    python check_certificate.py FILE...

From the numbers of an arm it works out what a sample adds, verifies the matrix inequality, and from its
solution every bound that is claimed; docs/proof.md says why they follow. It prints what it verified. Whether
the numbers are those of the arm is not its business: a seal shows slips, not fraud.
"""

import hashlib
import json
import os
import re
import stat
import sys
from fractions import Fraction
from functools import lru_cache
from math import comb, isqrt

FORMAT = "armgpi certificate 2"
#: Most bytes of a file, joints, and bandwidths times the third power of the inequality's size.
BYTES, JOINTS, WORK = 2_000_000, 64, 20_000_000
NUMBER = re.compile(r"-?[0-9]{1,40}(\.[0-9]{1,60})?(e[+-]?[0-9]{1,3})?")
WHOLE = {"integrators": (1, 3), "rolloff": (0, 2), "delay": (0, 20)}
LAW = ("sample_time", "rate", "zeta", "pole_ratio", "rolloff_ratio", "second_ratio", "second_zeta")
SINGLE = ("delta_low", "delta_high", "sigma", "kappa_v", "kappa_e", "kappa_g", "kappa_f", "sigma_error")
NUMBERS = dict.fromkeys((*SINGLE, "kappa_error", "jump", "count_time"), 0)
NUMBERS.update(inverse=1, hold=1, reach=1)
LIMITS = ("effort", "lower", "upper", "radius", "speed", "velocity", "acceleration")
INPUTS = ("torque", "shift", "count", "reference", "zone", "spread")
CLAIMS = {
    "gain": "an error per torque with the reference at rest, once settled",
    "stated": "the errors under all that was stated, once settled",
    "start": "the same from a start with the torque that holds the arm with another load of the range",
    "jump": "the same after the load jumped once, at any time",
}
SECTIONS = {"format", "robot", "assumptions", "limits", "law", "numbers", "status", "inputs", "shares"}


class Refused(ValueError):
    """What a file says is no certificate."""


#: What reading a file of any content may end in.
ERRORS = Refused, OSError, AttributeError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError


@lru_cache(maxsize=8)
def coefficients(m, r, zeta, pole, far, second, damping):
    """Return what takes the error into v at once, into integrators and filter, and out of it; in theta."""

    def times(p, q):
        found = [0] * (len(p) + len(q) - 1)
        for i, x in enumerate(p):
            for j, y in enumerate(q):
                found[i + j] += x * y
        return found

    def plus(p, q, sign=1):
        size = max(len(p), len(q))
        return [x + sign * y for x, y in zip(*([*z, *[0] * (size - len(z))] for z in (p, q)))]

    def trapezoidal(f):  # f_0 / s^k + ... at once, and in powers of 1 / (z - 1)
        k, half = len(f), Fraction(1, 2)
        later = [
            [0, *(comb(k - i, j - i) * half ** (j - i) * f[i] for i in range(j, -1, -1))] for j in range(k)
        ]
        return [0, *(half**i * f[k - i] for i in range(1, k + 1))], later[::-1]

    whole = times([1, 2 * zeta, 1], [second**2, 2 * damping * second, 1])
    for each in [pole] * (m - 1) + [far] * r:
        whole = times(whole, [each, 1])
    # The law is N / (s^m D) = direct + g_0 / s^m + ... + g_(m - 1) / s + F / D.
    N, D, g = [*whole[: m + 2], 0], whole[m + 2 :], []
    product = lambda j: sum(x * D[j - i] for i, x in enumerate(g) if 0 <= j - i < len(D))
    for j in range(m):
        g.append((N[j] - product(j)) / D[0])
    direct = 0 if r else N[m + 1]
    F = [N[m + j] - direct * D[j] - product(m + j) for j in range(1 + r)]
    (integral, drive), (passed, filtered), (shrunk, leak) = map(trapezoidal, (g, F, D[: 1 + r]))
    scale = plus([1], shrunk)
    over = times(scale, scale)
    at_once = times(plus(times(plus([direct], integral), scale), passed), scale)
    found = [over, [-x for x in at_once], *(times(x, over) for x in drive)]
    found += [plus(times(x, scale), times(passed, y), -1) for x, y in zip(filtered, leak)]
    return found + [times(x, scale) for x in leak]


def loop(c, omega):
    """Return unit vectors, the open loop over a sample, what the law asks for, and where it has the error."""
    m, r, d, theta = c["integrators"], c["rolloff"], c["delay"], omega * c["sample_time"]
    law = coefficients(m, r, *(c[x] for x in LAW[2:]))
    over, direct, *rest = (sum(x * theta**i for i, x in enumerate(p)) for p in law)
    drive, leak, n = rest[: m + 1 + r], rest[m + 1 + r :], 3 + m + r + d
    units = [[int(i == j) for j in range(n)] for i in range(n)]
    A, late = [list(row) for row in units], n - 1 if d else 0  # the errors of the last d samples are states
    for i in range(2, n - d):
        A[i][late] += drive[i - 2] / over
        A[i][2 + m] -= leak[i - 2 - m] / over if i >= 2 + m else 0
        if i not in (1 + m, n - d - 1):
            A[i][i + 1] += theta
    A[0][1], A[n - d :] = theta, [units[i - 1 if i > n - d else 0] for i in range(n - d, n)]
    return units, A, [direct / over if i == late else -int(i in (2, 2 + m)) for i in range(n)], late


def sample(c):
    """Return growths, rest, delta's ends, what a sample adds, the sizes of inputs, torque and noise."""
    h, d, kg, kf, s = (c[x] for x in ("sample_time", "delay", "kappa_g", "kappa_f", "spread"))
    least, most = min(c["omega"]), max(c["omega"])
    # The Coriolis torque of the error is there twice for the reference's speed, where that moves, and once
    # for its own.
    moves = bool(c["reference"])
    sigma, kv = moves * c["sigma"] + s * c["sigma_error"], moves * 2 * c["kappa_v"] + s * c["kappa_error"]
    # At least e^x: the series of e^-x is below it after a negative term.
    exponents = sigma * h, sigma * d * h + c["sigma"] * c["count_time"]
    f, wide = (1 / (1 - x + x * x / 2 - x**3 / 6) if x < 1 else 0 for x in exponents)
    rest = 1 - f * ((kv + kf) * h + kg * h * h / 2)
    low, high = (c["delta_low"] / wide, c["delta_high"] * wide) if wide else (0, 0)
    gains = high * (f - rest), (f - rest) * kf + f * (kv + h * kg), f * c["kappa_e"], min(d, 1) * f * kg
    noise = max(abs(K[late]) for _, _, K, late in (loop(c, x) for x in c["omega"])) * most**2 * c["count"]
    w = c["torque"] + (c["kappa_e"] + kg) * c["count"] + kg * (d + 1) * h * c["reference"]
    w, turn = f * w + gains[0] * noise, c["shift"] / least**3
    size = w / rest / least**2 if rest else 0
    return (
        (f, wide),
        rest,
        (low, high),
        gains,
        (size, size * most * h / 2, turn, c["count"], c["zone"]),
        w,
        noise,
    )


def inequality(c, known, omega, turn, delta, s):
    """Return the matrix that has to be positive definite, affine in P, t, a; turn: omega over the next."""
    ((f, _), rest, _, gains, sizes, *_), (units, A, K, late) = known, loop(c, omega)
    m, n, order, theta, P = c["integrators"], len(A), len(A) - c["delay"], omega * c["sample_time"], s["P"]
    rows = K, units[1], units[late], [x - y for x, y in zip(units[0], units[late])]
    scaled = [x / rest / min(c["omega"]) ** p for x, p in zip(gains, (0, 1, 2, 2))]
    sources = [(weight, x, y) for weight, x, y in zip(s["t"], scaled, rows) if x]
    held = [theta * theta / 2, theta] + [0] * (n - 2)  # an acceleration that is held
    push = [delta * x for x in held]
    count = [row[late] * (2 <= i < order) + x * K[late] for i, (row, x) in enumerate(zip(A, push))]
    zone = [row[late] * (2 <= i < 2 + m) for i, row in enumerate(A)]
    acts = [[theta * x for x in units[i]] for i in (1, 0, 2)] + [count, zone]
    columns = [(acts[0], weight) for weight, _, _ in sources] + [(acts[1], s["t"][4])]
    rubs = n + len(columns)
    columns += [(held, s["t"][5])] * bool(c["kappa_f"])
    columns += [(column, weight) for column, weight, size in zip(acts, s["a"], sizes) if size]
    Z = [[x + b * y for x, y in zip(A[i], K)] + [z[i] for z, _ in columns] for i, b in enumerate(push)]
    powers = [0, 1, *range(2, 2 + m), *range(2, order - m), *[0] * c["delay"]]  # of omega in the states
    Z = [[x * turn**p for x in row] for p, row in zip(powers, Z)]
    PZ = [[sum(x * z for x, z in zip(row, column)) for column in zip(*Z)] for row in P]
    X = [[-f * sum(x * z for x, z in zip(left, right)) for right in zip(*PZ)] for left in zip(*Z)]
    for i, (_, weight) in enumerate(columns):
        X[n + i][n + i] += theta * weight
    if c["kappa_f"]:  # friction takes energy: z^2 + kappa_f z e' <= 0
        X[1][rubs] += s["t"][5] * c["sample_time"] * c["kappa_f"] / 2
        X[rubs][1] = X[1][rubs]
    place = s["t"][4] * len(sources) * theta * theta / 4
    for i, j in ((i, j) for i in range(n) for j in range(n)):
        taken = sum((weight + place) * x * x * y[i] * y[j] for weight, x, y in sources)
        X[i][j] += P[i][j] * (1 - theta * s["alpha"]) - theta * taken
    return X


def pivots(M):
    """Return the pivots (L D L^T) of M until one is not positive; M rounded and made less (Gershgorin)."""
    M = [[Fraction(int(x * 2**128) - 2 * len(M) * (row is y), 2**128) for x, y in zip(row, M)] for row in M]
    found = [M[0][0]]
    while found[-1] > 0 and len(M) > 1:
        M = [[x - row[0] * y / found[-1] for x, y in zip(row[1:], M[0][1:])] for row in M[1:]]
        found.append(M[0][0])
    return found


def holds(c, s):
    """Tell whether the matrix inequality holds; omega is one of a list, and goes to a neighbour at most."""
    known, omegas, P, order = sample(c), c["omega"], s["P"], len(loop(c, c["omega"][0])[1])
    (f, wide), rest, ends, *_ = known
    sound = f >= 1 and wide >= 1 and 0 < rest <= 1 and s["alpha"] > 0
    sound = sound and len(s["t"]) == 6 and len(s["a"]) == 5 and min([*s["t"], *s["a"]]) >= 0
    sound = sound and len(P) == order and [list(row) for row in zip(*P)] == P and min(pivots(P)) > 0
    steps = [(x, x / y) for i, x in enumerate(omegas) for y in omegas[max(i - 1, 0) : i + 2]]
    matrices = (inequality(c, known, *step, delta, s) for step in steps for delta in ends)
    return sound and all(min(pivots(X)) > 0 for X in matrices)


def bounds(c, s, claim=""):
    """Return at least the errors, the speeds of the error and the torques, at all times."""
    ((f, wide), rest, (_, high), gains, sizes, w, noise), (units, _, _, late) = (
        sample(c),
        loop(c, c["omega"][0]),
    )
    h, P, least, fastest, kf = c["sample_time"], s["P"], min(c["omega"]), max(c["omega"]), c["kappa_f"]
    root = lambda x: Fraction(isqrt(int(x * 4**80)) + 1, 2**80)
    most = lambda y: root(-pivots([[*row, x] for row, x in zip(P, y)] + [[*y, 0]])[-1])
    ends = [most(units[0]), most(units[1]) * fastest, most(units[late])]
    ends.append(max(most(loop(c, omega)[2]) for omega in c["omega"]) * fastest**2)

    def motion(level, before=0):  # at most e, e' and e'' after a sample's part with another acceleration
        e, v, past, ask = (level * x for x in ends)
        e, v = e + h * v + h * h / 2 * before if before else e, v + h * before
        far = sum(x * y for x, y in zip(gains, (ask, v, past, e + past)))
        return e, v, high * (ask + noise) + kf * v + (w + far) / rest, ask

    level = root(sum(x * y * y for x, y in zip(s["a"], sizes)) / s["alpha"])
    other = root(P[2][2]) / least**2
    if claim == "start":
        off = c["jump"] + (c["kappa_e"] + c["kappa_g"]) * c["count"] / c["delta_low"]
        level = max(level, other * off)
    e, v, fast, ask = motion(level)
    if claim == "jump":  # at any time in a sample: till then one arm's acceleration, then the other's
        ratio = root(c["delta_high"] / c["delta_low"])
        level, first = ratio * level + other * c["jump"], f * ratio * fast
        fast = max(first, f * motion(level, first)[2])
        level += (root(P[0][0]) * h / 2 + root(P[1][1]) / least) * h * 2 * fast
        e, v, last, ask = motion(level)
        fast = max(fast, last)
    e, v = e + h * v + h * h / 2 * fast, root(f) * (v + h * fast)  # between samples
    errors = [root(f * x) * e + c["delay"] * h * y for x, y in zip(c["inverse"], c["velocity"])]
    torques = [x + root(wide) * y * (ask + noise) for x, y in zip(c["hold"], c["reach"])]
    return {"errors": errors, "speed": [v], "torques": torques}


def exact(x):
    """Return JSON with every text of a number as the rational that it is."""
    if isinstance(x, dict):
        return {key: exact(value) for key, value in x.items()}
    if isinstance(x, list):
        return [exact(value) for value in x]
    return Fraction(x) if isinstance(x, str) else x


def numbers(data, where, shape=0):
    """Return a number, or lists of them so deep, that are texts of bounded length."""
    if shape:
        if not isinstance(data, list) or not data:
            raise Refused(f"{where} has to be a list of numbers")
        return [numbers(x, where, shape - 1) for x in data]
    if not isinstance(data, str) or not NUMBER.fullmatch(data):
        raise Refused(f"{where} has to be a number as a text of bounded length")
    return Fraction(data)


def section(data, where, keys):
    """Return a mapping that has these keys and no others."""
    if not isinstance(data, dict) or set(data) != set(keys):
        raise Refused(f"{where} has to have {', '.join(sorted(keys))} and nothing else")
    return data


def facts(data):
    """Return what all claims rest on as exact numbers, each within what the proof takes it for."""
    law, robot = (
        section(data["law"], "law", ("integrators", "rolloff", "delay", "omega", *LAW)),
        data["robot"],
    )
    n = len(numbers(section(data["numbers"], "numbers", NUMBERS)["inverse"], "inverse", 1))
    found = {x: law[x] for x in ("integrators", "rolloff", "delay")}
    for (key, value), (low, high) in zip(found.items(), ((1, 3), (0, 2), (0, 20))):
        if type(value) is not int or not low <= value <= high:
            raise Refused(f"law.{key} has to be {low} to {high}")
    found.update(
        {key: numbers(law[key], f"law.{key}") for key in LAW}, omega=numbers(law["omega"], "omega", 1)
    )
    found.update({key: numbers(data["numbers"][key], key, deep) for key, deep in NUMBERS.items()})
    limits = section(data["limits"], "limits", LIMITS)
    found.update({key: numbers(limits[key], f"limits.{key}", 1) for key in LIMITS})
    size = 12 + sum(law[x] for x in WHOLE)
    sizes = {key: len(found[key]) for key in ("hold", "reach", *LIMITS)}
    omega, signed = found["omega"], ("lower", "upper")
    shape = isinstance(robot, dict) and isinstance(robot.get("joints"), list) and len(robot["joints"]) == n
    for fine, what in (
        (shape and n <= JOINTS and set(sizes.values()) == {n}, "one number for each joint"),
        (len(omega) * size**3 <= WORK, "fewer bandwidths"),
        (omega == sorted(set(omega)) and omega[0] > 0, "positive bandwidths that grow"),
        (all(found[key] > 0 for key in LAW if key != "rate"), "a positive law and sample time"),
        (0 < found["delta_low"] <= found["delta_high"], "delta between positive ends"),
        (all(x <= y for x, y in zip(found["lower"], found["upper"])), "lower ends below the upper ones"),
        (
            all(x >= 0 for k, v in found.items() if k not in signed for x in (v if type(v) is list else [v])),
            "no negative number",
        ),
    ):
        if not fine:
            raise Refused(f"expected {what}")
    return found


def solution(data, name, n):
    """Return a solution as exact numbers, with its claims."""
    s = section(data, name, ("P", "alpha", "t", "a", "claims"))
    claims = section(s["claims"], f"{name}.claims", ("errors", "speed", "torques"))
    found = {
        key: numbers(s[key], f"{name}.{key}", deep)
        for key, deep in zip(("P", "alpha", "t", "a"), (2, 0, 1, 1))
    }
    rows = [len(row) for row in found["P"]]
    if [len(found["t"]), len(found["a"]), *rows] != [6, 5, *[len(rows)] * len(rows)]:
        raise Refused(f"{name}: expected 6 numbers t, 5 numbers a and a square P")
    found["claims"] = {key: numbers(claims[key], f"{name}.claims.{key}", 1) for key in claims}
    sizes = {key: len(value) for key, value in found["claims"].items()}
    if sizes != {"errors": n, "speed": 1, "torques": n}:
        raise Refused(f"{name}.claims: expected an error and a torque for each joint, and one speed")
    return found


def check(certificate):
    """Return what is wrong with a certificate, a line each; nothing for one that holds."""
    try:
        return verify(certificate)
    except ERRORS as error:
        return [str(error) or type(error).__name__]


def verify(data):
    """Return what is wrong with a certificate whose parts are as they should be."""
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise Refused(f"the format is not {FORMAT!r}")
    section(data, "a certificate", SECTIONS | {"solutions", "seal"})
    sealed = {key: x for key, x in data.items() if key not in ("solutions", "seal")}
    if hashlib.sha256(json.dumps(sealed, sort_keys=True).encode()).hexdigest() != data["seal"]:
        raise Refused("the seal is broken")
    common, solutions = facts(data), data["solutions"]
    if not isinstance(solutions, dict) or not solutions or not set(solutions) <= set(CLAIMS):
        raise Refused(f"claims nothing, or more than {', '.join(CLAIMS)}")
    wrong = []
    for name, inputs in section(data["inputs"], "inputs", solutions).items():
        s = solution(solutions[name], name, len(common["inverse"]))
        sizes = section(inputs, f"inputs.{name}", INPUTS)
        c = {**common, **{key: numbers(x, f"inputs.{name}.{key}") for key, x in sizes.items()}}
        if min(c[key] for key in INPUTS) < 0 or (
            name != "gain" and any(c["velocity"]) != bool(c["reference"])
        ):
            raise Refused(f"inputs.{name}: negative, or at rest where the reference moves")
        if not holds(c, s):
            wrong.append(f"{name}: the matrix inequality does not hold")
            continue
        allowed = {"errors": c["radius"], "speed": [c["spread"]], "torques": c["effort"]}
        for what, values in bounds(c, s, name).items():
            if any(x > min(y, z) for x, y, z in zip(values, allowed[what], s["claims"][what])):
                wrong.append(f"{name}: {what} are larger than claimed or allowed")
    return wrong


def unclaimed(data):
    """Return what a file says that was asked for and that no claim of it is about, a phrase each."""
    robot, solutions = data["robot"], data["solutions"]
    asked = [any(Fraction(x) for x in data["limits"][key]) for key in ("velocity", "acceleration")]
    asked += [any(Fraction(x) for x in robot.get("torque") or ()), robot.get("friction"), robot.get("bits")]
    jumps = bool(Fraction(data["numbers"]["jump"]))
    missing = ["everything that was stated"] * (any(asked) and "stated" not in solutions)
    wrong_load = jumps and robot.get("start") == "wrong-load"
    missing += ["a start with the torque of another load"] * (wrong_load and "start" not in solutions)
    return missing + ["a jump of the load"] * bool(jumps and robot.get("jump") and "jump" not in solutions)


def text(x):
    """Return plain data on one line, without what moves a terminal."""
    return json.dumps(x)[:400]


def describe(data):
    """Return what was verified, and what was taken from the file as it is, a line each."""
    law = data["law"]
    verified = [
        f"the matrix inequality at {len(law['omega'])} bandwidths and both ends of delta, exactly",
        "every bound below follows from it and from the numbers of the arm, exactly",
        "the seal fits what it seals: no slip, which is no signature",
    ]
    for name, s in data["solutions"].items():
        size = f"torques up to {text(data['inputs'][name]['torque'])} in the metric of D^-1"
        errors = text(s["claims"]["errors"])
        verified.append(f"claim {name!r}: {errors} rad or m at most: {CLAIMS[name]}; {size}")
        verified.append(f"  with torques: {text(s['claims']['torques'])} N m or N at most")
    lists = ("VERIFIED here:", verified), ("TAKEN FROM THE FILE, not verified:", taken(data))
    return [line for head, rows in lists for line in (f"  {head}", *(f"    {row}" for row in rows))]


def taken(data):
    """Return what a certificate says and its checker cannot know, a line each."""
    robot, law, limits = data["robot"], data["law"], data["limits"]
    moves = any(Fraction(x) for x in limits["velocity"])
    arm = [robot.get(x) for x in ("name", "sha256", "armature", "locked")]
    proved = sorted(key for key, x in data["status"].items() if x == "proved")
    searched = sorted(key for key, x in data["status"].items() if x != "proved")
    member = f"{law['integrators']} integrators, roll-off {law['rolloff']}, {law['delay']} samples late"
    ends = text([law["omega"][0], law["omega"][-1]])
    rows = [
        ("the numbers of the arm", sorted(data["numbers"]), "are those of this arm in this box"),
        ("of these said to be proved", proved, ""),
        ("of these said to be searched for", searched, ""),
        ("arm", arm, "that it is rigid, and has this URDF"),
        ("loads [kg]", robot.get("loads"), "and all between"),
        ("joints", robot["joints"], ""),
        ("box, lower ends [rad or m]", limits["lower"], "the arm stays in it"),
        ("box, upper ends [rad or m]", limits["upper"], ""),
        ("reference", limits["velocity"] if moves else "at rest", "[rad/s or m/s]" if moves else ""),
        *[("its acceleration", limits["acceleration"], "[rad/s^2 or m/s^2]")] * moves,
        ("start", robot.get("start"), ""),
    ]
    said = [f"{name}: {text(value)} {more}".rstrip() for name, value, more in rows]
    return [*said, f"the controller that runs: {member}, omega [rad/s] {ends}, {law['sample_time']} s"]


def unique(pairs):
    """Return a JSON object none of whose keys is there twice."""
    if len(dict(pairs)) < len(pairs):
        raise Refused("a key is there twice")
    return dict(pairs)


def read(file):
    """Return a file's JSON; only of a regular file of bounded size."""
    if not stat.S_ISREG(os.stat(file).st_mode) or os.stat(file).st_size > BYTES:
        raise Refused(f"is no regular file of at most {BYTES} bytes")
    with open(file, encoding="utf-8") as stream:
        return json.load(stream, object_pairs_hook=unique)


def main(files):
    """Print what holds of some files.

    Returns 1 where a claim does not hold, 2 where a file is no certificate, 3 where all claims hold but
    something that was asked for has none.
    """
    found = set() if files else {2}
    for file in files:
        try:
            data = read(file)
            wrong, missing = verify(data), unclaimed(data)
            if wrong:
                said, code = "DOES NOT HOLD: " + "; ".join(wrong), 1
            elif missing:
                head = f"HOLDS FOR PART: asked for and not claimed: {'; '.join(missing)}"
                said, code = "\n".join([head, *describe(data)]), 3
            else:
                said, code = "\n".join(["HOLDS:", *describe(data)]), 0
        except ERRORS as error:
            said, code = f"IS NO CERTIFICATE: {text(str(error))}", 2
        found.add(code)
        print(file, said)
    return next(code for code in (2, 1, 3, 0) if code in found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
