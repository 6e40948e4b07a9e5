/* Many rollouts, LANES at a time: `sample` takes one sample of a closed loop and is generated. */
#define NR (VARIABLES * N)

typedef struct {
    double *state;         /* blocks of (NS + NR) vectors: the state, and what was recorded last */
    const double *shared;  /* parameters of all rollouts */
    const double *own;     /* blocks of NO vectors: each rollout's own */
    const double *table;   /* for every sample NT numbers, or NT rows of as many as there are lanes in all */
    const uint64_t *draws; /* for each draw: stream, samples ahead */
    const uint64_t *seeds; /* for each draw: the seed of every lane */
    void *const *out;      /* VARIABLES arrays (samples, rollouts, N), of floats if narrow; 0 for one that is not kept */
    double *sums;          /* blocks of NA vectors: what is added up over the samples */
    int64_t *ended;        /* sample at which a rollout diverged, -1 while it runs */
    int64_t rows, padded, table_rows, k0, k1, every, final; /* every 0: nothing is recorded */
    double divergence;
    int64_t late;          /* first sample of the last seconds */
    int64_t narrow;
} Job;

static U v_mix(U x)
{
    x = (x ^ (x >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94D049BB133111EB);
    return x ^ (x >> 31);
}

/* Numbers in (0, 1) as armgpi.plants.noise.uniform draws them, for every draw and joint. They are a function of
   seed, sample and joint, and each rollout has a seed, so a lane's are those of its rollout alone. Counts are integers: a double
   would lose the bits that are mixed. */
static void draw(const uint64_t *draws, const uint64_t *seeds, int64_t padded, int64_t k, V *u)
{
    const uint64_t golden = UINT64_C(0x9E3779B97F4A7C15);
    for (int d = 0; d < ND; ++d) {
        U key = {0};
        for (int i = 0; i < LANES; ++i) LANE(key, i) = seeds[d * padded + i] + golden;
        key = v_mix(key);
        for (uint64_t j = 0; j < N; ++j) {
            const uint64_t sample_number = (uint64_t)k + draws[2 * d + 1];
            const uint64_t counter = sample_number * 0x10000 + draws[2 * d] * 0x1000 + j;
            const U bits = v_mix(v_mix(key ^ (counter * golden)) + key) >> 11;
            V x = v_set(0.0);
            for (int i = 0; i < LANES; ++i) LANE(x, i) = (double)(int64_t)LANE(bits, i);
            u[d * N + (int)j] = (x + 0.5) * 0x1p-53;
        }
    }
}

/* Whole lines go past the cache: they are not read before they are written, and push nothing out. */
#if defined __AVX512F__ && LANES == 8
#define STREAM(to, from) _mm512_stream_pd(to, _mm512_load_pd(from))
#define WIDE 8
#elif defined __AVX__ && LANES == 4 && N % 2 == 0
#define STREAM(to, from) _mm256_stream_pd(to, _mm256_load_pd(from))
#define WIDE 4
#endif

static void record(const Job *job, int64_t block, int64_t k, const V *now, int whole)
{
    const size_t size = job->narrow ? sizeof(float) : sizeof(double);
    for (int x = 0; x < VARIABLES; ++x) {
        if (!job->out[x]) continue;
        double rows[LANES * N] __attribute__((aligned(64)));
        float narrow[LANES * N];
        for (int j = 0; j < N; ++j)
            for (int lane = 0; lane < LANES; ++lane) rows[lane * N + j] = LANE(now[x * N + j], lane);
        for (int i = 0; job->narrow && i < LANES * N; ++i) narrow[i] = (float)rows[i];
        char *to = (char *)job->out[x] + (k / job->every * job->rows + block * LANES) * N * size;
        const char *from = job->narrow ? (const char *)narrow : (const char *)rows;
#ifdef STREAM
        if (whole && !job->narrow && (uintptr_t)to % 64 == 0) {
            for (int i = 0; i < LANES * N; i += WIDE) STREAM((double *)to + i, rows + i);
            continue;
        }
#endif
        for (int lane = 0; lane < LANES; ++lane) {
            const int64_t row = block * LANES + lane;
            if (whole || (row < job->rows && job->ended[row] < 0))
                memcpy(to + lane * N * size, from + lane * N * size, N * size);
        }
    }
}

/* Take the samples k0 to k1 - 1 of some blocks. In the final one the torque is the one held before. */
void run(const Job *job, int64_t first, int64_t last)
{
    V state[2][NS + 1], now[NR], u[ND * N + 1], table[NT + 1], fixed[NC + 1];
    for (int64_t block = first; block < last; ++block) {
        double *memory = job->state + block * (NS + NR) * LANES;
        const V *own = (const V *)(job->own + block * NO * LANES);
        int runs[LANES];
        for (int i = 0; i < LANES; ++i) {
            const int64_t row = block * LANES + i;
            runs[i] = row < job->rows && job->ended[row] < 0;
        }
        M running = v_holding(runs);
        if (!v_any(running)) continue; /* all that are in it have diverged */
        prepare(job->shared, own, fixed);
        memcpy(state[0], memory, NS * sizeof(V));
        memcpy(now, memory + NS * LANES, sizeof now);
        V sums[2][NA + 1];
        /* Both: before the last seconds their sums are not written. */
        for (int i = 0; i < 2 && NA; ++i) memcpy(sums[i], job->sums + block * NA * LANES, NA * sizeof(V));
        int usual = 0; /* of the last two samples, which were usual: a bit each */
        int turn = 0; /* the two states take turns, as the sample reads one while it writes the other */
        for (int64_t k = job->k0; k < job->k1; ++k, turn ^= 1) {
            V held[NR];
            if (job->final) memcpy(held, now, sizeof held);
            for (int i = 0; i < NT; ++i) {
                const int64_t at = (k - job->k0) * NT + i;
                if (job->table_rows) memcpy(&table[i], job->table + at * job->padded + block * LANES, sizeof(V));
                else table[i] = v_set(job->table[at]);
            }
            draw(job->draws, job->seeds + block * LANES, job->padded, k, u);
            const int took = sample(state[turn], state[turn ^ 1], job->shared, own, fixed, table, u,
                v_set((double)k), now, usual == 3);
            usual = (usual << 1 | took) & 3;
            if (job->final) memcpy(now + HELD * N, held + HELD * N, (VARIABLES - HELD) * N * sizeof(V));
            /* The rule of armgpi.loop.runner.in_control; what is NaN is not <= anything. */
            M good = running;
            for (int j = 0; j < N; ++j) {
                good &= v_le(v_abs(now[j] - now[2 * N + j]), v_set(job->divergence));
                good &= v_lt(v_abs(now[N + j]), v_set(INFINITY));
                good &= v_lt(v_abs(now[TAU * N + j]), v_set(INFINITY));
            }
            if (v_any(running & v_not(good))) {
                for (int i = 0; i < LANES; ++i)
                    if (v_holds(running, i) && !v_holds(good, i)) job->ended[block * LANES + i] = k;
                running = good;
                if (!v_any(running)) break;
            }
            if (NA && k < job->late) add_early(now, job->shared, own, v_set((double)k), sums[turn], sums[turn ^ 1]);
            else if (NA) add_up(now, job->shared, own, v_set((double)k), sums[turn], sums[turn ^ 1]);
            if (job->every && k % job->every == 0) record(job, block, k, now, v_all(running));
        }
        if (NA) memcpy(job->sums + block * NA * LANES, sums[turn], NA * sizeof(V));
        memcpy(memory, state[turn], NS * sizeof(V));
        memcpy(memory + NS * LANES, now, sizeof now);
    }
#ifdef STREAM
    _mm_sfence(); /* other threads see what went past the cache */
#endif
}
