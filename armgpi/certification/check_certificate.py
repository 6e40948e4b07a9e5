"""Check certificates of armgpi in exact arithmetic, with the standard library alone.

    python check_certificate.py FILE...

From the numbers of an arm it works out what a sample adds, verifies the matrix inequality, and from its
solution every bound that is claimed. The numbers and the law's coefficients are sealed, and not its business.
"""

import hashlib
import json
import sys
from fractions import Fraction
from math import isqrt


def loop(c, omega):
    """Return unit vectors, the open loop over a sample, what the law asks for, and where it has the error."""
    m, r, d, theta = c["integrators"], c["rolloff"], c["delay"], omega * c["sample_time"]
    over, direct, *rest = (sum(x * theta**i for i, x in enumerate(p)) for p in c["coefficients"])
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
    """Return growth, rest, delta's ends, what a sample adds, the sizes of inputs, torque and noise."""
    h, d, kg, s, (least, most) = (
        c["sample_time"],
        c["delay"],
        c["kappa_g"],
        c["spread"],
        (min(c["omega"]), max(c["omega"])),
    )
    sigma, kv = c["sigma"] + s * c["sigma_error"], c["kappa_v"] + s * c["kappa_error"]
    # At least e^x: the series of e^-x is below it after a negative term.
    f, wide = (1 / (1 - x + x * x / 2 - x**3 / 6) for x in (sigma * h, sigma * (d * h + c["count_time"])))
    rest, low, high = 1 - f * (kv * h + kg * h * h / 2), c["delta_low"] / wide, c["delta_high"] * wide
    gains = high * (f - rest), f * (kv + h * kg), f * c["kappa_e"], min(d, 1) * f * kg
    noise = max(abs(K[late]) for _, _, K, late in (loop(c, x) for x in c["omega"])) * most**2 * c["count"]
    w = c["torque"] + (c["kappa_e"] + kg) * c["count"] + kg * (d + 1) * h * c["reference"]
    w, turn = f * w + gains[0] * noise, c["shift"] / least**3
    size = w / rest / least**2
    return f, rest, (low, high), gains, (size, size * most * h / 2, turn, c["count"]), w, noise


def inequality(c, known, omega, turn, delta, s):
    """Return the matrix that has to be positive definite, affine in P, t, a; turn: omega over the next."""
    (f, rest, _, gains, sizes, *_), (units, A, K, late) = known, loop(c, omega)
    m, n, order, theta, P = c["integrators"], len(A), len(A) - c["delay"], omega * c["sample_time"], s["P"]
    rows = K, units[1], units[late], [x - y for x, y in zip(units[0], units[late])]
    scaled = [x / rest / min(c["omega"]) ** p for x, p in zip(gains, (0, 1, 2, 2))]
    sources = [(weight, x, y) for weight, x, y in zip(s["t"], scaled, rows) if x]
    push = [delta * theta * theta / 2, delta * theta] + [0] * (n - 2)
    count = [row[late] * (2 <= i < order) + x * K[late] for i, (row, x) in enumerate(zip(A, push))]
    acts = [[theta * x for x in units[i]] for i in (1, 0, 2)] + [count]
    columns = [(acts[0], weight) for weight, _, _ in sources] + [(acts[1], s["t"][4])]
    columns += [(column, weight) for column, weight, size in zip(acts, s["a"], sizes) if size]
    Z = [[x + b * y for x, y in zip(A[i], K)] + [z[i] for z, _ in columns] for i, b in enumerate(push)]
    powers = [0, 1, *range(2, 2 + m), *range(2, order - m), *[0] * c["delay"]]  # of omega in the states
    Z = [[x * turn**p for x in row] for p, row in zip(powers, Z)]
    PZ = [[sum(x * z for x, z in zip(row, column)) for column in zip(*Z)] for row in P]
    X = [[-f * sum(x * z for x, z in zip(left, right)) for right in zip(*PZ)] for left in zip(*Z)]
    for i, (_, weight) in enumerate(columns):
        X[n + i][n + i] += theta * weight
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
    f, rest, ends, *_ = known
    sound = f >= 1 and 0 < rest <= 1 and s["alpha"] > 0 and len(s["t"]) == 5 and len(s["a"]) == 4
    sound = sound and len(P) == order and [list(row) for row in zip(*P)] == P and min(pivots(P)) > 0
    steps = [(x, x / y) for i, x in enumerate(omegas) for y in omegas[max(i - 1, 0) : i + 2]]
    matrices = (inequality(c, known, *step, delta, s) for step in steps for delta in ends)
    return sound and all(min(pivots(X)) > 0 for X in matrices)


def bounds(c, s, jump=False):
    """Return at least the errors, the speeds of the error and the torques, at all times."""
    (f, rest, (_, high), gains, sizes, w, noise), (units, _, _, late) = sample(c), loop(c, c["omega"][0])
    h, P, least, fastest = c["sample_time"], s["P"], min(c["omega"]), max(c["omega"])
    root = lambda x: Fraction(isqrt(int(x * 4**80)) + 1, 2**80)
    most = lambda y: root(-pivots([[*row, x] for row, x in zip(P, y)] + [[*y, 0]])[-1] * V)
    V = sum(x * y * y for x, y in zip(s["a"], sizes)) / s["alpha"]
    if jump:
        V = (root(c["delta_high"] / c["delta_low"] * V) + root(P[2][2]) * c["jump"] / least**2) ** 2
    e, v, past = most(units[0]), most(units[1]) * fastest, most(units[late])
    ask = max(most(loop(c, omega)[2]) for omega in c["omega"]) * fastest**2
    fast = high * ask + (w + sum(x * y for x, y in zip(gains, (ask, v, past, e + past)))) / rest
    e, v = e + h * v + h * h / 2 * fast, root(f) * (v + h * fast)  # between samples
    errors = [root(f * x) * e + c["delay"] * h * y for x, y in zip(c["inverse"], c["velocity"])]
    torques = [x + y * (ask + noise) for x, y in zip(c["hold"], c["reach"])]
    return {"errors": errors, "speed": [v], "torques": torques}


def exact(x):
    """Return JSON with every text of a number as the rational that it is."""
    if isinstance(x, dict):
        return {key: exact(value) for key, value in x.items()}
    return [exact(value) for value in x] if isinstance(x, list) else Fraction(x) if isinstance(x, str) else x


def check(certificate):
    """Return what is wrong with a certificate, a line each; nothing for one that holds."""
    sealed = {key: x for key, x in certificate.items() if key not in ("solutions", "seal")}
    if hashlib.sha256(json.dumps(sealed, sort_keys=True).encode()).hexdigest() != certificate["seal"]:
        return ["the seal is broken"]
    wrong, facts = [], {**certificate["limits"], **certificate["law"], **certificate["numbers"]}
    for name, s in exact(certificate["solutions"]).items():
        c = exact({**facts, **certificate["inputs"][name]})
        if not holds(c, s):
            wrong.append(f"{name}: the matrix inequality does not hold")
            continue
        allowed = {"errors": c["radius"], "speed": [c["spread"]], "torques": c["effort"]}
        for what, values in bounds(c, s, name == "jump").items():
            if any(x > min(y, z) for x, y, z in zip(values, allowed[what], s["claims"][what])):
                wrong.append(f"{name}: {what} are larger than claimed or allowed")
    return wrong


if __name__ == "__main__":
    failed = False
    for file in sys.argv[1:]:
        with open(file, encoding="utf-8") as stream:
            wrong = check(json.load(stream))
        print(file, "DOES NOT HOLD: " + "; ".join(wrong) if wrong else "HOLDS, if its sealed numbers do")
        failed = failed or bool(wrong)
    sys.exit(failed)
