/* A step of solvers/map.py over its n unknowns; matrices in single precision. */
#include "kernel.h"

#include <math.h>
#include <string.h>

enum { BLOCK = 4 }; /* rows taken at once: fewer ways to memory */

/* The diagonal of (U^T U)^-1: the squared length of each row of U^-1. */
VECTORISED void inverse_diagonal(const float *restrict u, ptrdiff_t n,
                                        float *restrict row, double *restrict diagonal)
{
    for (ptrdiff_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (ptrdiff_t k = i; k < n; k++)
            row[k] = 0.0f;
        row[i] = 1.0f;
        for (ptrdiff_t j = i; j < n; j += BLOCK) {
            ptrdiff_t end = j + BLOCK < n ? j + BLOCK : n;
            float v[BLOCK] = {0.0f};
            for (ptrdiff_t l = j; l < end; l++) {
                v[l - j] = row[l] / u[l * n + l];
                sum += v[l - j] * v[l - j];
                for (ptrdiff_t k = l + 1; k < end; k++)
                    row[k] -= v[l - j] * u[l * n + k];
            }
            const float *restrict u0 = u + j * n;
            for (ptrdiff_t k = end; k < n; k++)
                row[k] -= v[0] * u0[k] + v[1] * u0[n + k] + v[2] * u0[2 * n + k]
                          + v[3] * u0[3 * n + k];
        }
        diagonal[i] = sum;
    }
}

/* S = U^T U, both (n, n) in the upper triangle of s; -1 if S is not positive definite. */
VECTORISED static int cholesky(float *restrict s, ptrdiff_t n)
{
    for (ptrdiff_t i = 0; i < n; i += BLOCK) {
        ptrdiff_t end = i + BLOCK < n ? i + BLOCK : n;
        for (ptrdiff_t l = i; l < end; l++) {
            float *restrict row = s + l * n;
            for (ptrdiff_t j = i; j < l; j++)
                for (ptrdiff_t k = l; k < n; k++)
                    row[k] -= s[j * n + l] * s[j * n + k];
            if (!(row[l] > 0.0f))
                return -1;
            float scale = 1.0f / sqrtf(row[l]);
            for (ptrdiff_t k = l; k < n; k++)
                row[k] *= scale;
        }
        const float *restrict r = s + i * n;
        for (ptrdiff_t j = end; j < n; j++) { /* only reached by whole blocks */
            float *restrict other = s + j * n;
            float a = r[j], b = r[n + j], c = r[2 * n + j], d = r[3 * n + j];
            for (ptrdiff_t k = j; k < n; k++)
                other[k] -= a * r[k] + b * r[n + k] + c * r[2 * n + k] + d * r[3 * n + k];
        }
    }
    return 0;
}

/* x <- (U^T U)^-1 x */
static void solve(const float *restrict u, ptrdiff_t n, double *restrict x)
{
    for (ptrdiff_t i = 0; i < n; i++) {
        x[i] /= u[i * n + i];
        for (ptrdiff_t k = i + 1; k < n; k++)
            x[k] -= u[i * n + k] * x[i];
    }
    for (ptrdiff_t i = n - 1; i >= 0; i--) {
        double sum = x[i];
        for (ptrdiff_t k = i + 1; k < n; k++)
            sum -= u[i * n + k] * x[k];
        x[i] = sum / u[i * n + i];
    }
}

static inline float entry(const float *s, ptrdiff_t n, ptrdiff_t i, ptrdiff_t k)
{
    return i < k ? s[i * n + k] : s[k * n + i];
}

/* map._solve_in_box: minimise 1/2 dx S dx - b dx; what would leave [low, high] is put on its end.
 * `u` becomes the factor over those `inside`, (m, m). Returns m, -1 if there is no factor. */
ptrdiff_t solve_in_box(const float *restrict s, ptrdiff_t n, const double *restrict b,
                               const double *restrict low, const double *restrict high, int rounds,
                               double *restrict dx, char *restrict inside, float *restrict u,
                               double *restrict pull, ptrdiff_t *restrict at)
{
    static const float ridges[] = {0.0f, 1e-3f, 1e-2f, 1e-1f, 1.0f};
    ptrdiff_t m = n;

    memset(inside, 1, n);
    for (ptrdiff_t i = 0; i < n; i++)
        dx[i] = 0.0;
    for (int round = 1;; round++) {
        m = 0;
        for (ptrdiff_t i = 0; i < n; i++)
            if (inside[i])
                at[m++] = i;
        int failed = -1;
        float stretch = 1.0f; /* of the diagonal, where S is not definite to single precision */
        for (size_t r = 0; failed && r < sizeof ridges / sizeof *ridges; r++) {
            stretch *= 1.0f + ridges[r];
            for (ptrdiff_t i = 0; i < m; i++) {
                for (ptrdiff_t k = i; k < m; k++)
                    u[i * m + k] = s[at[i] * n + at[k]];
                u[i * m + i] *= stretch;
            }
            failed = cholesky(u, m);
        }
        if (failed)
            return -1;
        for (ptrdiff_t i = 0; i < m; i++) {
            pull[i] = b[at[i]];
            for (ptrdiff_t k = 0; m < n && k < n; k++)
                if (!inside[k])
                    pull[i] -= entry(s, n, at[i], k) * dx[k];
        }
        solve(u, m, pull);
        ptrdiff_t out = 0;
        for (ptrdiff_t i = 0; i < m; i++) {
            dx[at[i]] = pull[i];
            out += pull[i] < low[at[i]] || pull[i] > high[at[i]];
        }
        int done = round == rounds || !out || out == m;
        for (ptrdiff_t i = 0; i < n; i++) {
            if (!done && (dx[i] < low[i] || dx[i] > high[i]))
                inside[i] = 0;
            dx[i] = fmin(fmax(dx[i], low[i]), high[i]);
        }
        if (done)
            return m;
    }
}

/* Add the prior's entries to the precision over the n unknowns; `place` of each cell, or -1. */
void join(float *restrict precision, ptrdiff_t n, const int *restrict place,
          const double *restrict entries, const int *restrict here, const int *restrict there,
          ptrdiff_t n_entries)
{
    for (ptrdiff_t e = 0; e < n_entries; e++) {
        int i = place[here[e]], k = place[there[e]];
        if (i >= 0 && k >= 0)
            precision[i * n + k] += (float)entries[e];
    }
}
