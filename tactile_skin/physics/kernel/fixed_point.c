/* The accelerated fixed point: numpy_kernel.py holds the same in NumPy. */
#include "kernel.h"

#include <math.h>
#include <string.h>
#include <time.h>

/* Solve the (n, n) system s x = b, both overwritten; rows of s are HISTORY apart. */
static void solve_small(double *s, double *b, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            double factor = s[j * HISTORY + i] / s[i * HISTORY + i];
            for (int k = i; k < n; k++)
                s[j * HISTORY + k] -= factor * s[i * HISTORY + k];
            b[j] -= factor * b[i];
        }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= s[i * HISTORY + k] * b[k];
        b[i] /= s[i * HISTORY + i];
    }
}

/* Seconds on a clock that is never set. */
static double now(void)
{
    struct timespec t;
#ifdef CLOCK_MONOTONIC
    clock_gettime(CLOCK_MONOTONIC, &t);
#else
    timespec_get(&t, TIME_UTC);
#endif
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* x within [low, high]; NaN stays NaN, which fmin and fmax would turn into a bound. */
static inline double clip(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

/* The sum of a[i] b[i], in four parts: one would wait for each addition. */
static inline double dot(const double *restrict a, const double *restrict b, ptrdiff_t n)
{
    double sum[4] = {0.0};
    ptrdiff_t i = 0;

    for (; i + 4 <= n; i += 4)
        for (int part = 0; part < 4; part++)
            sum[part] += a[i + part] * b[i + part];
    for (; i < n; i++)
        sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* kernel.fixed_point over the n cells `at`: g becomes the last point. Returns the steps taken, -1
 * if the network is singular to rounding. `space` holds ITERATE_SPACE vectors of n. Gives up after
 * `seconds`, which may be infinite. */
VECTORISED int iterate(int rows, int cols, double *restrict g, const int *restrict at, ptrdiff_t n,
                       const double *restrict measured, const double *restrict low,
                       const double *restrict high, double r_ref, double r_par, double goal,
                       int steps, double seconds, double *restrict space,
                       Network *restrict network)
{
    double *restrict x = space, *restrict misfit = space + n, *restrict last = space + 2 * n;
    double *restrict image = space + 3 * n, *restrict adc = space + 4 * n;
    double *restrict off = space + 5 * n, *restrict d_misfit = space + 6 * n;
    double *restrict d_image = d_misfit + HISTORY * n;
    double rho[CELLS], gram[HISTORY * HISTORY], deadline = now() + seconds;

    for (ptrdiff_t i = 0; i < n; i++)
        x[i] = log(g[at[i]]);
    for (ptrdiff_t i = 0; i < n; i++)
        adc[i] = r_ref / (r_ref + r_par + measured[i]);
    for (int step = 0; step < steps; step++) {
        if (network_of(g, rows, cols, network) < 0)
            return -1;
        two_terminal(rows, cols, network, rho);
        for (ptrdiff_t i = 0; i < n; i++)
            misfit[i] = rho[at[i]];
        for (ptrdiff_t i = 0; i < n; i++) {
            off[i] = r_ref / (r_ref + r_par + misfit[i]) - adc[i];
            misfit[i] /= measured[i];
        }
        if (dot(off, off, n) <= goal || now() > deadline)
            return step;
        int slot = (step + HISTORY - 1) % HISTORY, used = step < HISTORY ? step : HISTORY;
        double *restrict last_d_misfit = d_misfit + slot * n;
        double *restrict last_d_image = d_image + slot * n;
        for (ptrdiff_t i = 0; i < n; i++)
            misfit[i] = log(misfit[i]);
        for (ptrdiff_t i = 0; i < n; i++) {
            double plain = x[i] + misfit[i];
            last_d_misfit[i] = misfit[i] - last[i];
            last_d_image[i] = plain - image[i];
            last[i] = misfit[i];
            image[i] = x[i] = plain;
        }
        double matrix[HISTORY * HISTORY], share[HISTORY], trace = 0.0;
        for (int a = 0; a < used; a++) {
            gram[a * HISTORY + slot] = gram[slot * HISTORY + a]
                = dot(d_misfit + a * n, last_d_misfit, n);
            share[a] = dot(d_misfit + a * n, misfit, n);
        }
        for (int a = 0; a < used; a++)
            trace += gram[a * HISTORY + a];
        memcpy(matrix, gram, sizeof gram);
        for (int a = 0; a < used; a++)
            matrix[a * HISTORY + a] += 1e-10 * trace + 1e-30;
        solve_small(matrix, share, used);
        for (int a = 0; a < used; a++)
            for (ptrdiff_t i = 0; i < n; i++)
                x[i] -= share[a] * d_image[a * n + i];
        for (ptrdiff_t i = 0; i < n; i++)
            x[i] = clip(x[i], low[i], high[i]);
        for (ptrdiff_t i = 0; i < n; i++)
            g[at[i]] = exp(x[i]);
    }
    return steps;
}
