"""Check certificates of armgpi in exact arithmetic, with the standard library alone.

    python check_certificate.py FILE...

It computes what the numbers of the arm make of a sample, verifies the matrix inequality in rational numbers
at both ends of delta (it is convex in between), and from its solution every bound that the file claims. The
numbers of the arm are not its business: it checks that they are those that were sealed, no more.
"""

import hashlib
import json
import sys
from fractions import Fraction
from math import comb, isqrt, lcm

MOVING = ("sigma", "sigma_error"), ("kappa_v", "kappa_error")
SEALED = "format", "robot", "assumptions", "limits", "law", "numbers", "status", "inputs"


def matmul(A, B):
    """Return the product of two matrices."""
    return [[sum(a * b for a, b in zip(row, column)) for column in zip(*B)] for row in A]


def times(p, q):
    """Return the product of two polynomials, lowest power first."""
    at = range(len(p))
    return [sum(p[i] * q[k - i] for i in at if 0 <= k - i < len(q)) for k in range(len(p) + len(q) - 1)]


def trapezoidal(f, half):
    """Return f_0 / s^k + f_1 / s^(k - 1) + ... at once, and in powers of 1 / (z - 1)."""
    k = len(f)
    later = [sum(comb(k - i, j - i) * half ** (j - i) * f[i] for i in range(j + 1)) for j in range(k)]
    return sum(x * half ** (k - i) for i, x in enumerate(f)), [2 * half * x for x in reversed(later)]


def loop(law, theta):
    """Return the open loop, its output v and what acts now; omega = 1 and the sample time is theta."""
    m, r, d, w2, half = law["integrators"], law["rolloff"], law["delay"], law["second_ratio"], theta / 2
    whole = times([1, 2 * law["zeta"], 1], [w2 * w2, 2 * law["second_zeta"] * w2, 1])
    for pole in [law["pole_ratio"]] * (m - 1) + [law["rolloff_ratio"]] * r:
        whole = times(whole, [pole, 1])
    N, D, g, F = whole[: m + 2] + [0], whole[m + 2 :] + [0] * m, [], []
    k = 0 if r else N[m + 1]
    for j in range(m):
        g.append((N[j] - sum(g[i] * D[j - i] for i in range(j))) / D[0])
    for j in range(1 + r):
        F.append(N[m + j] - k * D[j] - sum(g[i] * D[m + j - i] for i in range(m)))
    (integral, drive), (shrunk, leak) = trapezoidal(g, half), trapezoidal(D[: 1 + r], half)
    (passed, filtered), leak = trapezoidal(F, half), [x / (1 + shrunk) for x in leak]
    passed, n = passed / (1 + shrunk), 3 + m + r
    drive += [x / (1 + shrunk) - passed * y for x, y in zip(filtered, leak)]
    A = [[int(i == j) for j in range(n + 2 * d)] for i in range(n + 2 * d)]
    A[0][1], K = theta, [-(k + integral + passed)] + [-int(i in (2, 2 + m)) for i in range(1, n + 2 * d)]
    for i, gain in enumerate(drive):
        A[2 + i][0] = gain
        A[2 + i][2 + m] -= leak[i - m] if i >= m else 0
        if i not in (m - 1, m + r):
            A[2 + i][3 + i] += theta
    for i in range(n, n + 2 * d):  # what was asked for in the last d samples, then the errors at them
        A[i] = K if i == n else [int(j == (0 if i == n + d else i - 1)) for j in range(n + 2 * d)]
    return A, K, [int(j == n + d - 1) for j in range(n + 2 * d)] if d else K


def units(law):
    """Return the order of the loop, its unit vectors, and the powers of omega that its states have."""
    m, r, d = law["integrators"], law["rolloff"], law["delay"]
    powers = [0, 1, *range(2, 2 + m), *range(2, 3 + r)] + [2] * d + [0] * d
    return len(powers), [[int(i == j) for j in range(len(powers))] for i in range(len(powers))], powers


def exp_up(x):
    """Return at least e^x for 0 <= x < 1."""
    return 1 / (1 - x + x * x / 2 - x * x * x / 6)


def sample(law, numbers, spread):
    """Return growth, rest, the interval of delta and the gains of what a sample adds (docs: One sample)."""
    h, d, kg = law["sample_time"], law["delay"], numbers["kappa_g"]
    sigma, kv = (numbers[x] + spread * numbers[y] for x, y in MOVING)
    f, wide = exp_up(sigma * h), exp_up(sigma * (d * h + numbers["count_time"]))
    low, high = numbers["delta_low"] / wide, numbers["delta_high"] * wide
    rest = 1 - f * (kv * h + kg * h * h / 2)
    return (
        f,
        rest,
        (low, high),
        (high * (f - rest), f * (kv + h * kg), f * numbers["kappa_e"], min(d, 1) * f * kg),
    )


def inequality(law, numbers, spread, omega, ratio, delta, P, alpha, t, a):
    """Return the matrix that has to be positive definite; it is affine in P and the multipliers t and a."""
    theta, (f, rest, _, gains) = omega * law["sample_time"], sample(law, numbers, spread)
    (A, K, Y), d, (n, unit, powers) = loop(law, theta), min(law["delay"], 1), units(law)
    past, order = unit[d * (n - 1)], 3 + law["integrators"] + law["rolloff"]
    rows = Y, unit[1], past, [x - y for x, y in zip(unit[0], past)]
    scaled = [c / rest / omega**p for c, p in zip(gains, (0, 1, 2, 2))]
    sources = [(weight, c, y) for weight, c, y in zip(t, scaled, rows) if c]
    push = [delta * theta * theta / 2, delta * theta] + [0] * (n - 2)
    count = [0, 0] + [row[0] for row in A[2 : order + d]] + [0] * (n - order - d)
    count = [(x + (1 - d) * y * K[0]) / theta for x, y in zip(count, push)]
    columns = [(unit[1], weight) for weight, _, _ in sources] + [(unit[0], t[4])]
    columns += list(zip((unit[1], unit[0], unit[2], count), a))
    Z = [
        [x + b * y for x, y in zip(A[i], Y)] + [theta * c[i] for c, _ in columns] for i, b in enumerate(push)
    ]
    Z = [[x / ratio**p for x in row] for p, row in zip(powers, Z)]  # omega is ratio times as large next time
    X = [[-f * x / theta for x in row] for row in matmul(list(zip(*Z)), matmul(P, Z))]
    for i, (_, weight) in enumerate(columns):
        X[n + i][n + i] += weight
    place = t[4] * len(sources) * theta * theta / 4
    for i, j in ((i, j) for i in range(n) for j in range(n)):
        X[i][j] += P[i][j] * (1 / theta - alpha) - sum(
            (w + place) * c * c * y[i] * y[j] for w, c, y in sources
        )
    return X


def pivots(M):
    """Return the pivots of a symmetric matrix (L D L^T) up to the first that is not positive, by Bareiss."""
    scale = lcm(*(Fraction(x).denominator for row in M for x in row))
    rows, found, last = [[int(x * scale) for x in row] for row in M], [], 1
    for k, row in enumerate(rows):
        found.append(Fraction(row[k], last * scale))
        if row[k] <= 0:
            break
        for below in rows[k + 1 :]:
            below[k:] = [(row[k] * x - below[k] * y) // last for x, y in zip(below[k:], row[k:])]
        last = row[k]
    return found


def positive(M):
    """Tell if M is positive definite, rounded to 2^-128 and less what that may add (Gershgorin)."""
    n = len(M)
    return (
        min(
            pivots(
                [
                    [Fraction(int(x * 2**128) - 2 * n * (i == j), 2**128) for j, x in enumerate(row)]
                    for i, row in enumerate(M)
                ]
            )
        )
        > 0
    )


def root_up(x):
    """Return at least the square root."""
    return Fraction(isqrt(int(x * 4**80)) + 1, 2**80)


def sizes(law, numbers, inputs):
    """Return the sizes of torque, shift and count as the inequality has them, and the torque itself."""
    h, (f, rest, _, gains) = law["sample_time"], sample(law, numbers, inputs["spread"])
    least, most = law["omega"]
    noise = abs(loop(law, most * h)[1][0]) * most**2 * inputs["count"]
    w = inputs["torque"] + (numbers["kappa_e"] + numbers["kappa_g"]) * inputs["count"]
    w = f * (w + numbers["kappa_g"] * (law["delay"] + 1) * h * inputs["reference"])
    w += gains[0] * noise
    unit = w / rest / least**2
    return (unit, unit * most * h / 2, inputs["shift"] / least**3, inputs["count"]), w, noise


def bounds(law, numbers, inputs, s, jump=False):
    """Return at least the errors, the speeds of the error and the torques, at all times."""
    h, d, P, (least, most) = law["sample_time"], law["delay"], s["P"], law["omega"]
    (_, K, Y), (n, unit, _) = loop(law, most * h), units(law)
    f, rest, (_, high), gains = sample(law, numbers, inputs["spread"])
    size, w, noise = sizes(law, numbers, inputs)
    V = sum(x * y * y for x, y in zip(s["a"], size)) / s["alpha"]
    if jump:
        y = [x - int(n - 2 * d <= i < n - d) for i, x in enumerate(unit[2])]
        shifted = root_up(matmul([y], matmul(P, list(zip(y))))[0][0]) * numbers["jump"] / least**2
        V = (root_up(numbers["delta_high"] / numbers["delta_low"] * V) + shifted) ** 2

    def most_of(y, power):
        return root_up(-pivots([[*row, x] for row, x in zip(P, y)] + [[*y, 0]])[-1] * V) * most**power

    e, v, now, ask = most_of(unit[0], 0), most_of(unit[1], 1), most_of(Y, 2), most_of(K, 2) + noise
    past = most_of(unit[min(d, 1) * (n - 1)], 0)
    fast = high * now + (w + sum(c * x for c, x in zip(gains, (now, v, past, e + past)))) / rest
    scales = [root_up(f * x) for x in numbers["inverse"]]
    errors, speed = [x * (e + h * v + h * h / 2 * fast) for x in scales], root_up(f) * (v + h * fast)
    torques = [x + y * ask for x, y in zip(numbers["hold"], numbers["reach"])]
    return {"errors": errors, "speed": [speed], "torques": torques}


def exact(x):
    """Return JSON with every text of a number as the rational that it is."""
    if isinstance(x, dict):
        return {key: exact(value) for key, value in x.items()}
    return [exact(value) for value in x] if isinstance(x, list) else Fraction(x) if isinstance(x, str) else x


def symmetric(rows):
    """Return the symmetric matrix with a lower triangle."""
    return [[rows[max(i, j)][min(i, j)] for j in range(len(rows))] for i in range(len(rows))]


def holds(law, numbers, spread, s):
    """Tell whether the matrix inequality holds: at both ends of delta, and of the change of omega."""
    h, (_, rest, ends, _) = law["sample_time"], sample(law, numbers, spread)
    if rest <= 0 or s["alpha"] <= 0 or not positive(s["P"]):
        return False
    for omega in law["bandwidths"]:
        for ratio in {1 - law["rate"] * omega * h, 1 + law["rate"] * omega * h}:
            for delta in ends:
                X = inequality(law, numbers, spread, omega, ratio, delta, s["P"], s["alpha"], s["t"], s["a"])
                if not positive(X):
                    return False
    return True


def allowed(limits, inputs):
    """Return what bounds must stay within: what the numbers were taken over, and what the motors give."""
    return {"errors": limits["radius"], "speed": [inputs["spread"]], "torques": limits["effort"]}


def leaves(limits, inputs, found):
    """Return which bounds are not within what is allowed."""
    most = allowed(limits, inputs)
    return [key for key in most if any(x > y for x, y in zip(found[key], most[key]))]


def check(certificate):
    """Return what is wrong with a certificate, a line each; nothing for one that holds."""
    sealed = json.dumps({key: certificate[key] for key in SEALED}, sort_keys=True)
    if hashlib.sha256(sealed.encode()).hexdigest() != certificate["seal"]:
        return ["the seal is broken"]
    wrong = []
    law, numbers, inputs, limits = (exact(certificate[key]) for key in ("law", "numbers", "inputs", "limits"))
    for name, s in exact(certificate["solutions"]).items():
        s["P"] = symmetric(s["P"])
        if not holds(law, numbers, inputs[name]["spread"], s):
            wrong.append(f"{name}: the matrix inequality does not hold")
            continue
        found = bounds(law, numbers, inputs[name], s, name == "jump")
        wrong += [f"{name}: {what} beyond what was allowed" for what in leaves(limits, inputs[name], found)]
        for what, values in found.items():
            if any(x > y for x, y in zip(values, s["claims"][what])):
                wrong.append(f"{name}: {what} are larger")
    return wrong


if __name__ == "__main__":
    failed = 0
    for file in sys.argv[1:]:
        with open(file, encoding="utf-8") as stream:
            problems = check(json.load(stream))
        print(
            file, "DOES NOT HOLD: " + "; ".join(problems) if problems else "HOLDS, if its sealed numbers do"
        )
        failed += bool(problems)
    sys.exit(failed > 0)
