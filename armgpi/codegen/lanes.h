/* Arithmetic on LANES numbers at once, one rollout in each: GCC's and Clang's vector types, nothing else.
   A rollout per lane, not a joint per lane: rollouts do the same at the same time and never wait for each other,
   whatever the number of joints, so no lane is idle and none exchanges numbers with another. */
#include <stddef.h>
#include <stdint.h>
#ifdef BARE /* no C library: what the compiler has itself, and names of what no code here may use then */
#define memcpy __builtin_memcpy
#define fabs __builtin_fabs
#define sqrt __builtin_sqrt
#define INFINITY __builtin_inf()
#define NAN __builtin_nan("")
double exp(double), log(double), tan(double), tanh(double), atan(double), fmod(double, double);
#else
#include <math.h>
#include <string.h>
#endif

#if LANES > 1
typedef double V __attribute__((vector_size(8 * LANES)));
typedef uint64_t U __attribute__((vector_size(8 * LANES)));
#define LANE(x, i) ((x)[i])
static inline V v_set(double x) { return x - (V){0}; }
static inline U v_bits(V x) { return (U)x; }
static inline V v_from(U x) { return (V)x; }
#else
typedef double V;
typedef uint64_t U;
#define LANE(x, i) (x)
static inline V v_set(double x) { return x; }
static inline U v_bits(V x) { U u; memcpy(&u, &x, sizeof u); return u; }
static inline V v_from(U u) { V x; memcpy(&x, &u, sizeof x); return x; }
#endif

#if LANES > 1 && defined __AVX__
#if defined __clang__ || (__GNUC__ != 11 && __GNUC__ != 12)
#include <immintrin.h>
#else /* names of GCC 11 and 12 themselves, tried with both: the header takes half of what a small loop does */
typedef unsigned char __mmask8;
typedef double __m256d __attribute__((vector_size(32), may_alias));
typedef double __m512d __attribute__((vector_size(64), may_alias));
typedef long long __m512i __attribute__((vector_size(64), may_alias));
enum { _CMP_EQ_OQ = 0, _CMP_NEQ_UQ = 4, _CMP_LT_OQ = 17, _CMP_LE_OQ = 18 };
#define ALL (__mmask8)-1
#define NOW 4 /* the rounding that is set */
#define _mm512_cmp_pd_mask(a, b, how) (__mmask8)__builtin_ia32_cmppd512_mask(a, b, how, ALL, NOW)
#define _mm512_maskz_mov_pd(m, x) __builtin_ia32_movapd512_mask(x, (__m512d){0}, m)
#define _mm512_mask_blend_pd(m, x, y) __builtin_ia32_blendmpd_512_mask(x, y, m)
#define _mm512_set1_epi64(x) ((__m512i){0} + (x))
#define _mm512_test_epi64_mask(x, y) (__mmask8)__builtin_ia32_ptestmq512(x, y, ALL)
#define _mm512_min_pd(a, b) __builtin_ia32_minpd512_mask(a, b, (__m512d){0}, ALL, NOW)
#define _mm512_max_pd(a, b) __builtin_ia32_maxpd512_mask(a, b, (__m512d){0}, ALL, NOW)
#define _kand_mask8(a, b) (__mmask8)__builtin_ia32_kandqi(a, b)
#define _kor_mask8(a, b) (__mmask8)__builtin_ia32_korqi(a, b)
#define _mm512_load_pd(from) *(const __m512d *)(from)
#define _mm512_stream_pd(to, x) __builtin_ia32_movntpd512(to, x)
#define _mm256_blendv_pd(x, y, m) __builtin_ia32_blendvpd256(x, y, m)
#define _mm256_min_pd(a, b) __builtin_ia32_minpd256(a, b)
#define _mm256_max_pd(a, b) __builtin_ia32_maxpd256(a, b)
#define _mm256_load_pd(from) *(const __m256d *)(from)
#define _mm256_stream_pd(to, x) __builtin_ia32_movntpd256(to, x)
#define _mm_sfence() __builtin_ia32_sfence()
#endif
#endif

/* M holds a boolean for each lane: a mask register where there are such, else all bits of a number. Both sides
   of a decision are worked out, and the mask selects: lanes cannot branch apart. */
#if LANES == 8 && defined __AVX512F__ && defined __AVX512DQ__
typedef __mmask8 M;
#define v_lt(a, b) _mm512_cmp_pd_mask((__m512d)(a), (__m512d)(b), _CMP_LT_OQ)
#define v_le(a, b) _mm512_cmp_pd_mask((__m512d)(a), (__m512d)(b), _CMP_LE_OQ)
#define v_eq(a, b) _mm512_cmp_pd_mask((__m512d)(a), (__m512d)(b), _CMP_EQ_OQ)
#define v_ne(a, b) _mm512_cmp_pd_mask((__m512d)(a), (__m512d)(b), _CMP_NEQ_UQ)
/* By name: compilers take & to another kind of register, and back. */
#define v_and(a, b) _kand_mask8(a, b)
#define v_or(a, b) _kor_mask8(a, b)
#define v_not(m) ((M)~(m))
static inline V v_only(M m, V x) { return (V)_mm512_maskz_mov_pd(m, (__m512d)x); }
static inline V v_select(M m, V x, V y) { return (V)_mm512_mask_blend_pd(m, (__m512d)y, (__m512d)x); }
static inline M v_odd(U x) { return _mm512_test_epi64_mask((__m512i)x, _mm512_set1_epi64(1)); }
static inline int v_any(M m) { return m != 0; }
static inline int v_holds(M m, int i) { return m >> i & 1; }
static inline M v_holding(const int *flags)
{
    M m = 0;
    for (int i = 0; i < LANES; ++i) m |= (M)((flags[i] != 0) << i);
    return m;
}
/* The hardware's minimum gives its second operand where one is NaN. */
static inline V v_lower(V a, V b) { return (V)_mm512_min_pd((__m512d)b, (__m512d)a); }
static inline V v_upper(V a, V b) { return (V)_mm512_max_pd((__m512d)b, (__m512d)a); }
#else
#define v_and(a, b) ((a) & (b))
#define v_or(a, b) ((a) | (b))
#if LANES > 1
typedef int64_t M __attribute__((vector_size(8 * LANES)));
#define v_not(m) (~(m))
static inline V v_only(M m, V x) { return v_from((U)m & v_bits(x)); }
#else
typedef int64_t M; /* any bit: what the compiler makes of ?: is faster than masks of all bits */
#define v_not(m) ((M)!(m))
static inline V v_only(M m, V x) { return m ? x : 0.0; }
#endif
#define v_lt(a, b) ((M)((a) < (b)))
#define v_le(a, b) ((M)((a) <= (b)))
#define v_eq(a, b) ((M)((a) == (b)))
#define v_ne(a, b) ((M)((a) != (b)))
static inline M v_odd(U x) { return (M)(-(x & 1)); }
static inline int v_holds(M m, int i) { return LANE(m, i) != 0; }
static inline int v_any(M m)
{
    int64_t one = 0;
    for (int i = 0; i < LANES; ++i) one |= LANE(m, i);
    return one != 0;
}
static inline M v_holding(const int *flags)
{
    M m = {0};
    for (int i = 0; i < LANES; ++i) LANE(m, i) = flags[i] ? -1 : 0;
    return m;
}
#if LANES == 4 && defined __AVX__
static inline V v_select(M m, V x, V y) { return (V)_mm256_blendv_pd((__m256d)y, (__m256d)x, (__m256d)m); }
static inline V v_lower(V a, V b) { return (V)_mm256_min_pd((__m256d)b, (__m256d)a); }
static inline V v_upper(V a, V b) { return (V)_mm256_max_pd((__m256d)b, (__m256d)a); }
#elif LANES == 1
static inline V v_select(M m, V x, V y) { return m ? x : y; }
static inline V v_lower(V a, V b) { return b < a ? b : a; }
static inline V v_upper(V a, V b) { return b > a ? b : a; }
#else
static inline V v_select(M m, V x, V y) { return v_from(((U)m & v_bits(x)) | (~(U)m & v_bits(y))); }
static inline V v_lower(V a, V b) { return v_select(v_lt(b, a), b, a); }
static inline V v_upper(V a, V b) { return v_select(v_lt(a, b), b, a); }
#endif
#endif

/* What has to hold in every lane is collected, one number turns back at once; both in a function that says 0 then.
   Not v_and: compilers make one instruction of & and the comparison before it. */
#if LANES > 1
#define v_require(m) held &= (m)
#else
#define v_require(m) if (!(m)) return 0
#endif
static inline int v_all(M m) { return !v_any(v_not(m)); }

static inline V v_number(M m) { return v_only(m, v_set(1.0)); }
#if LANES > 1
static inline V v_abs(V x) { return v_from(v_bits(x) & ((U)v_bits(v_set(0.0)) + INT64_MAX)); }
#else
static inline V v_abs(V x) { return fabs(x); }
#endif
/* NaN on either side comes out, as from NumPy's minimum and maximum; v_lower and v_upper check a alone. */
static inline V v_min(V a, V b) { return v_select(v_ne(b, b), b, v_lower(a, b)); }
static inline V v_max(V a, V b) { return v_select(v_ne(b, b), b, v_upper(a, b)); }

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

/* One by one, from libm: vector versions of these differ between libraries in the last place. */
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
EACH(v_tan, tan)
EACH(v_tanh, tanh)
EACH(v_atan, atan)
static inline V v_fmod(V x, V y)
{
    V z = x;
    for (int i = 0; i < LANES; ++i) LANE(z, i) = fmod(LANE(x, i), LANE(y, i));
    return z;
}

/* Sine and cosine are in every kernel, so they are worked out for all lanes at once: x - k pi / 2 in three
   parts (Cody, Waite 1980), then fdlibm's polynomials on [-pi/4, pi/4]. The absolute error is below 1.6e-16 for
   |x| < 1e6 (tests); NaN and infinity give NaN. */
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
    const V y = v_select(v_odd(q.quadrant), q.cosine, q.sine);
    return v_from(v_bits(y) ^ ((q.quadrant & 2) << 62));
}
static inline V v_cos(V x)
{
    const Quarter q = v_quarter(x);
    const V y = v_select(v_odd(q.quadrant), q.sine, q.cosine);
    return v_from(v_bits(y) ^ (((q.quadrant + 1) & 2) << 62));
}
