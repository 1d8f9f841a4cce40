/* The quadratic programme of a step: ../quadratic.py holds the same with LAPACK. */
#include "kernel.h"

#include <math.h>

enum { ROUNDS = 4 };

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

/* Fills dx, which unknowns stayed inside their bounds, and the factor over these, row by row;
 * their number, or -1 if there is no factor. `space` holds n floats, `kept` n integers. */
ptrdiff_t solve_in_box(ptrdiff_t n, const float *restrict precision, const double *restrict b,
                       const double *restrict low, const double *restrict high,
                       double *restrict dx, float *restrict factor, int *restrict inside,
                       float *restrict space, int *restrict kept)
{
    for (ptrdiff_t i = 0; i < n; i++)
        inside[i] = 1;
    for (int round = 1;; round++) {
        ptrdiff_t m = 0, out = 0;
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
            out += space[i] < low[kept[i]] || space[i] > high[kept[i]];
        }
        int last = round == ROUNDS || out == 0 || out == m;
        for (ptrdiff_t i = 0; i < m; i++) {
            ptrdiff_t k = kept[i];
            if (!last && (dx[k] < low[k] || dx[k] > high[k]))
                inside[k] = 0;
            dx[k] = fmin(fmax(dx[k], low[k]), high[k]);
        }
        if (last)
            return m;
    }
}
