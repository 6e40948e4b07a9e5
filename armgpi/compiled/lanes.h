/* Arithmetic on LANES numbers at once, one rollout in each: GCC's and Clang's vector types, nothing else. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#if LANES > 1
typedef double V __attribute__((vector_size(8 * LANES)));
typedef int64_t M __attribute__((vector_size(8 * LANES)));
typedef uint64_t U __attribute__((vector_size(8 * LANES)));
#define LANE(x, i) ((x)[i])
#define v_lt(a, b) ((M)((a) < (b)))
#define v_le(a, b) ((M)((a) <= (b)))
#define v_eq(a, b) ((M)((a) == (b)))
#define v_ne(a, b) ((M)((a) != (b)))
static inline V v_set(double x) { return x - (V){0}; }
static inline U v_bits(V x) { return (U)x; }
static inline V v_from(U x) { return (V)x; }
#else
typedef double V;
typedef int64_t M;
typedef uint64_t U;
#define LANE(x, i) (x)
#define v_lt(a, b) (-(M)((a) < (b)))
#define v_le(a, b) (-(M)((a) <= (b)))
#define v_eq(a, b) (-(M)((a) == (b)))
#define v_ne(a, b) (-(M)((a) != (b)))
static inline V v_set(double x) { return x; }
static inline U v_bits(V x) { U u; memcpy(&u, &x, sizeof u); return u; }
static inline V v_from(U u) { V x; memcpy(&x, &u, sizeof x); return x; }
#endif

#define v_not(m) (~(m))
static inline V v_only(M m, V x) { return v_from((U)m & v_bits(x)); }
static inline V v_select(M m, V x, V y) { return v_from(((U)m & v_bits(x)) | (~(U)m & v_bits(y))); }
static inline V v_number(M m) { return v_only(m, v_set(1.0)); }
static inline V v_abs(V x) { return v_from(v_bits(x) & ((U)v_bits(v_set(0.0)) + INT64_MAX)); }
static inline int v_any(M m)
{
    int64_t one = 0;
    for (int i = 0; i < LANES; ++i) one |= LANE(m, i);
    return one != 0;
}
/* NaN on either side comes out, as from NumPy's minimum and maximum. */
static inline V v_min(V a, V b) { return v_select(v_lt(a, b) | v_ne(a, a), a, b); }
static inline V v_max(V a, V b) { return v_select(v_lt(b, a) | v_ne(a, a), a, b); }

/* Nearest whole number, an even one from halfway: adding 2^52 leaves no room for a fraction. */
static inline V v_rint(V x)
{
    const V big = v_set(0x1p52), size = v_abs(x);
    const U sign = v_bits(x) ^ v_bits(size);
    return v_select(v_lt(size, big), v_from(v_bits((size + big) - big) | sign), x);
}
static inline V v_floor(V x)
{
    const V near = v_rint(x);
    return near - v_number(v_lt(x, near));
}
static inline V v_sign(V x)
{
    return v_select(v_ne(x, x), x, v_number(v_lt(v_set(0.0), x)) - v_number(v_lt(x, v_set(0.0))));
}

#define EACH(name, f)                                                  \
    static inline V name(V x)                                          \
    {                                                                  \
        V y = x;                                                       \
        for (int i = 0; i < LANES; ++i) LANE(y, i) = f(LANE(x, i));    \
        return y;                                                      \
    }
EACH(v_sqrt, sqrt)
EACH(v_exp, exp)
EACH(v_log, log)

/* Sine and cosine: x - k pi / 2 in three parts (Cody, Waite 1980), then fdlibm's polynomials on
   [-pi/4, pi/4]. The absolute error is below 1.6e-16 for |x| < 1e6 (tests); NaN and infinity give NaN. */
typedef struct { V sine, cosine; U quadrant; } Quarter;
static inline Quarter v_quarter(V x)
{
    const V big = v_set(0x1.8p52);
    const V shifted = x * 6.36619772367581382433e-01 + big;
    const V k = shifted - big;
    V r = x - k * 1.57079632673412561417e+00;
    r = r - k * 6.07710050630396597660e-11;
    r = r - k * 2.02226624879595063154e-21;
    const V z = r * r;
    const V s = ((((1.58969099521155010221e-10 * z - 2.50507602534068634195e-08) * z
        + 2.75573137070700676789e-06) * z - 1.98412698298579493134e-04) * z
        + 8.33333333332248946124e-03) * z - 1.66666666666666324348e-01;
    const V c = ((((-1.13596475577881948265e-11 * z + 2.08757232129817482790e-09) * z
        - 2.75573143513906633035e-07) * z + 2.48015872894767294178e-05) * z
        - 1.38888888888741095749e-03) * z + 4.16666666666666019037e-02;
    const V half = 0.5 * z, w = 1.0 - half;
    return (Quarter){r + r * (z * s), w + (((1.0 - w) - half) + z * z * c), v_bits(shifted)};
}
static inline V v_sin(V x)
{
    const Quarter q = v_quarter(x);
    const V y = v_select((M)(-(q.quadrant & 1)), q.cosine, q.sine);
    return v_from(v_bits(y) ^ ((q.quadrant & 2) << 62));
}
static inline V v_cos(V x)
{
    const Quarter q = v_quarter(x);
    const V y = v_select((M)(-(q.quadrant & 1)), q.sine, q.cosine);
    return v_from(v_bits(y) ^ (((q.quadrant + 1) & 2) << 62));
}
