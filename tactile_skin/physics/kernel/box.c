/* The quadratic programme of a step: ../quadratic.py holds the same with LAPACK. */
#include "kernel.h"

#include <math.h>

enum { ROUNDS = 8 };

/* M = U^T U, U in the upper triangle; -1 if M is not positive definite, or holds NaN. */
VECTORISED static int cholesky(ptrdiff_t m, float *restrict matrix)
{
    for (ptrdiff_t i = 0; i < m; i++) {
        float *restrict row = matrix + i * m;
        if (!(row[i] > 0.0f) || !(row[i] < INFINITY))
            return -1;
        float scale = 1.0f / sqrtf(row[i]);
        for (ptrdiff_t k = i; k < m; k++)
            row[k] *= scale;
        for (ptrdiff_t j = i + 1; j < m; j++) {
            float factor = row[j], *restrict below = matrix + j * m;
            for (ptrdiff_t k = j; k < m; k++)
                below[k] -= factor * row[k];
        }
    }
    return 0;
}

/* x <- (U^T U)^-1 x */
VECTORISED static void substitute(ptrdiff_t m, const float *restrict upper, float *restrict x)
{
    for (ptrdiff_t i = 0; i < m; i++) {
        const float *restrict row = upper + i * m;
        float here = x[i] /= row[i];
        for (ptrdiff_t k = i + 1; k < m; k++)
            x[k] -= here * row[k];
    }
    for (ptrdiff_t i = m - 1; i >= 0; i--) {
        const float *restrict row = upper + i * m;
        float sum = x[i];
        for (ptrdiff_t k = i + 1; k < m; k++)
            sum -= row[k] * x[k];
        x[i] = sum / row[i];
    }
}

/* Which unknowns the next round has inside: not those that leave their bounds, and again those on an
 * end that would leave it inwards. Their number, or -1 if the round had the same inside. */
static ptrdiff_t choose(ptrdiff_t n, const float *restrict precision, const double *restrict b,
                        const double *restrict low, const double *restrict high,
                        const double *restrict dx, const int *restrict inside, int *restrict next)
{
    ptrdiff_t changed = 0, left = 0;
    for (ptrdiff_t k = 0; k < n; k++) {
        next[k] = 0;
        if (inside[k])
            next[k] = dx[k] >= low[k] && dx[k] <= high[k];
        else if (low[k] < high[k]) {
            double pull = b[k];
            for (ptrdiff_t j = 0; j < n; j++)
                pull -= dx[j] * (j < k ? precision[j * n + k] : precision[k * n + j]);
            next[k] = dx[k] == low[k] ? pull > 0.0 : pull < 0.0;
        }
        changed += next[k] != inside[k];
        left += next[k];
    }
    return changed ? left : -1;
}

/* Fills dx, which unknowns stayed inside their bounds, and the factor over these, row by row;
 * their number, or -1 if there is no factor. `space` holds n floats, `kept` 2 n integers. */
ptrdiff_t solve_in_box(ptrdiff_t n, const float *restrict precision, const double *restrict b,
                       const double *restrict low, const double *restrict high,
                       double *restrict dx, float *restrict factor, int *restrict inside,
                       float *restrict space, int *restrict kept)
{
    int *next = kept + n;
    for (ptrdiff_t i = 0; i < n; i++)
        inside[i] = 1;
    for (int round = 1;; round++) {
        ptrdiff_t m = 0;
        for (ptrdiff_t i = 0; i < n; i++)
            if (inside[i])
                kept[m++] = (int)i;
        for (ptrdiff_t i = 0; i < m; i++) {
            const float *row = precision + kept[i] * n;
            for (ptrdiff_t j = i; j < m; j++)
                factor[i * m + j] = row[kept[j]];
            double pull = b[kept[i]];
            for (ptrdiff_t j = 0; j < n && m < n; j++)
                if (!inside[j])
                    pull -= dx[j] * (j < kept[i] ? precision[j * n + kept[i]] : row[j]);
            space[i] = (float)pull;
        }
        if (cholesky(m, factor) < 0)
            return -1;
        substitute(m, factor, space);
        for (ptrdiff_t i = 0; i < m; i++) {
            if (!isfinite(space[i]))
                return -1;
            dx[kept[i]] = space[i];
        }
        ptrdiff_t left = choose(n, precision, b, low, high, dx, inside, next);
        for (ptrdiff_t k = 0; k < n; k++)
            dx[k] = fmin(fmax(dx[k], low[k]), high[k]);
        if (left < 0 || round == ROUNDS)
            return m;
        for (ptrdiff_t k = 0; k < n; k++)
            inside[k] = next[k];
        if (left == 0 && choose(n, precision, b, low, high, dx, inside, next) < 0) {
            for (ptrdiff_t i = 0; i < m; i++) /* all are on their ends: the factor is the last one's */
                inside[kept[i]] = 1;
            return m;
        }
        for (ptrdiff_t k = 0; k < n && left == 0; k++)
            inside[k] = next[k];
    }
}
