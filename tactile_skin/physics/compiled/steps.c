/* SPDX-License-Identifier: Apache-2.0 */
/* The parts of a step of `map`: the prior (../../solvers/prior.py), its network's convolutions
 * (../../learning/convolution.py), the curve (../curve.py) and the programme within bounds
 * (../quadratic.py), which hold the same in NumPy. Functions return -1 where NumPy has to do it.
 */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { BOX_ROUNDS = 8 }; /* as quadratic.py's */

#define FAR 1e100 /* beyond it a product of squares is not multiplied by another */

/* out[k] += the sum over m rows of factors[j] rows[j][k], n of each, rows `stride` apart. */
static inline void combine(float *restrict out, int n, const float *restrict factors,
                           const float *restrict rows, int stride, int m)
{
    int j = 0;

    for (; j + 4 <= m; j += 4) {
        const float a = factors[j], b = factors[j + 1], c = factors[j + 2], d = factors[j + 3];
        const float *one = rows + j * stride, *two = rows + (j + 1) * stride;
        const float *three = rows + (j + 2) * stride, *four = rows + (j + 3) * stride;
        for (int k = 0; k < n; k++)
            out[k] += (a * one[k] + b * two[k]) + (c * three[k] + d * four[k]);
    }
    for (; j < m; j++)
        for (int k = 0; k < n; k++)
            out[k] += factors[j] * rows[j * stride + k];
}

/* A sum of w log(s) / 2, with one logarithm for many s of one w. */
typedef struct {
    double sum, weight, product;
} Logs;

static inline void add(Logs *logs, double weight, double square)
{
    if (weight != logs->weight || !(logs->product < FAR && logs->product > 1.0 / FAR)) {
        logs->sum += 0.5 * logs->weight * log(logs->product);
        logs->weight = weight;
        logs->product = 1.0;
    }
    logs->product *= square;
}

/* prior.touches; gradient and diagonal come as zeros. Returns the cost. */
double touches(int rows, int cols, const double *x, const double *weight, double spread,
               double *gradient, double *diagonal, double *entries)
{
    Logs logs = {0.0, 0.0, 1.0};

    for (int down = 0, d = 0; down < 2; down++)
        for (int i = 0; i < rows - down; i++)
            for (int j = 0; j < cols - !down; j++, d++) {
                int a = i * cols + j, b = down ? a + cols : a + 1;
                double apart = x[b] - x[a], s = spread * spread + apart * apart;
                double w = weight[d] / s, pull = w * apart;
                add(&logs, weight[d], s);
                entries[d] = -w;
                gradient[b] += pull;
                gradient[a] -= pull;
                diagonal[b] += w;
                diagonal[a] += w;
            }
    for (int a = 0; a < rows * cols; a++) {
        add(&logs, 2.0, 1.0 + x[a] / spread);
        gradient[a] += 1.0 / (x[a] + spread);
    }
    return logs.sum + 0.5 * logs.weight * log(logs.product);
}

/* The prior's part of prior.precision: adds it to the upper triangle of total, (n, n), over the
 * `free` cells, rising. entries: NULL, or of the differences. -1: there are no such cells. */
int add_terms(int rows, int cols, int n, const int *at, const double *diagonal,
              const double *entries, float *total)
{
    int cells = rows * cols, failed = 0, *place = calloc(cells + 1, sizeof *place);

    for (int k = 0; k < n; k++)
        failed |= at[k] < 0 || at[k] >= cells || (k && at[k] <= at[k - 1]);
    if (!place || failed) {
        free(place);
        return -1;
    }
    for (int k = 0; k < n; k++) {
        total[k * n + k] += (float)diagonal[at[k]];
        place[at[k]] = k + 1;
    }
    for (int down = 0, d = 0; entries && down < 2; down++)
        for (int i = 0; i < rows - down; i++)
            for (int j = 0; j < cols - !down; j++, d++) {
                int a = i * cols + j, b = down ? a + cols : a + 1;
                if (place[a] && place[b])
                    total[(place[a] - 1) * n + place[b] - 1] += (float)entries[d];
            }
    free(place);
    return 0;
}

/* curve.Table at n places: `start` holds the last of m rising points at or below the begin of each of
 * m - 1 equal parts of the table's length, from where the search is short. */
int interpolate(int n, const double *x, int m, const double *points, const double *values,
                const int *start, double *out)
{
    double first = points[0], last = points[m - 1], parts = (m - 1) / (last - first);

    for (int i = 0; i < n; i++) {
        if (!(x[i] > first && x[i] < last)) { /* NaN stays NaN */
            out[i] = x[i] <= first ? values[0] : x[i] >= last ? values[m - 1] : x[i];
            continue;
        }
        int part = (int)((x[i] - first) * parts), at = start[part < m - 1 ? part : m - 2];
        while (points[at + 1] <= x[i])
            at++;
        double slope = (values[at + 1] - values[at]) / (points[at + 1] - points[at]);
        out[i] = values[at] + slope * (x[i] - points[at]);
    }
    return 0;
}

/* out[k] += what the 3 x 3 taps `f`, d apart, see of a picture whose rows are `wide` apart. */
static void filter(float *restrict out, int n, const float *restrict f, const float *restrict p,
                   ptrdiff_t wide, ptrdiff_t d)
{
    const float *q = p + d * wide, *r = q + d * wide;
    float a = f[0], b = f[1], c = f[2], e = f[3], g = f[4], h = f[5], u = f[6], v = f[7], w = f[8];

    for (ptrdiff_t k = 0; k < n; k++)
        out[k] += (a * p[k] + b * p[k + d] + c * p[k + 2 * d])
                  + (e * q[k] + g * q[k + d] + h * q[k + 2 * d])
                  + (u * r[k] + v * r[k + d] + w * r[k + 2 * d]);
}

/* learning.convolution.convolve; out (outputs, rows, cols). */
int convolve(int rows, int cols, int channels, int outputs, int dilation, const float *picture,
             const float *layer, float *out)
{
    int d = dilation, wide = cols + 2 * d, plane = (rows + 2 * d) * wide, run = rows * wide;
    /* the last taps reach past the last cell, and what they see there is not copied */
    float *padded = calloc((size_t)channels * plane + 2 * d + run, sizeof *padded);
    float *sums = padded + channels * plane + 2 * d;

    if (!padded)
        return -1;
    for (int c = 0; c < channels; c++)
        for (int i = 0; i < rows; i++)
            memcpy(padded + c * plane + (i + d) * wide + d, picture + (c * rows + i) * cols,
                   cols * sizeof *padded);
    for (int o = 0; o < outputs; o++) {
        const float *f = layer + o * (9 * channels + 1);
        for (int k = 0; k < run; k++)
            sums[k] = f[9 * channels];
        for (int c = 0; c < channels; c++) /* rows with their margins, as one run */
            filter(sums, run, f + 9 * c, padded + c * plane, wide, d);
        for (int i = 0; i < rows; i++)
            memcpy(out + (o * rows + i) * cols, sums + i * wide, cols * sizeof *out);
    }
    free(padded);
    return 0;
}

/* M = U^T U, U in the upper triangle; -1 if M is not positive definite, or holds NaN. */
static int cholesky(int m, float *matrix, float *factors)
{
    for (int i = 0; i < m; i++) {
        float *row = matrix + i * m;
        for (int j = 0; j < i; j++)
            factors[j] = -matrix[j * m + i];
        combine(row + i, m - i, factors, matrix + i, m, i);
        if (!(row[i] > 0.0f) || !(row[i] < INFINITY))
            return -1;
        float scale = 1.0f / sqrtf(row[i]);
        for (int k = i; k < m; k++)
            row[k] *= scale;
    }
    return 0;
}

/* x <- (U^T U)^-1 x */
static void substitute(int m, const float *restrict upper, float *restrict x)
{
    for (int i = 0; i < m; i++) {
        const float *row = upper + i * m;
        float here = x[i] /= row[i];
        for (int k = i + 1; k < m; k++)
            x[k] -= here * row[k];
    }
    for (int i = m - 1; i >= 0; i--) {
        const float *row = upper + i * m;
        float sum[4] = {0.0f};
        int k = i + 1;
        for (; k + 4 <= m; k += 4)
            for (int q = 0; q < 4; q++)
                sum[q] += row[k + q] * x[k + q];
        for (; k < m; k++)
            sum[0] += row[k] * x[k];
        x[i] = (x[i] - ((sum[0] + sum[1]) + (sum[2] + sum[3]))) / row[i];
    }
}

/* (b - precision dx)_k, of an upper triangle. */
static double pull(int n, const float *precision, const double *b, const double *dx, int k)
{
    double left = b[k];

    for (int j = 0; j < k; j++)
        left -= dx[j] * precision[j * n + k];
    for (int j = k; j < n; j++)
        left -= dx[j] * precision[k * n + j];
    return left;
}

/* quadratic._inside_next. Returns how many are inside, or -1: the same as before. */
static int choose(int n, const float *precision, const double *b, const double *low,
                  const double *high, const double *dx, const int *inside, int *next)
{
    int changed = 0, left = 0;

    for (int k = 0; k < n; k++) {
        next[k] = inside[k] && dx[k] >= low[k] && dx[k] <= high[k];
        if (!inside[k] && low[k] < high[k]) {
            double inwards = pull(n, precision, b, dx, k);
            next[k] = dx[k] == low[k] ? inwards > 0.0 : inwards < 0.0;
        }
        changed += next[k] != inside[k];
        left += next[k];
    }
    return changed ? left : -1;
}

/* quadratic.solve_in_box: fills dx (zeros before), which unknowns stayed inside, and the factor over
 * these, row by row. Returns their number; -1: there is no factor. */
int solve_in_box(int n, const float *precision, const double *b, const double *low,
                 const double *high, double *dx, float *factor, int *inside)
{
    int *kept = malloc(2 * n * sizeof *kept + 1), *next = kept + n;
    float *x = malloc(2 * n * sizeof *x + 1), *factors = x + n;
    int m = kept && x ? 0 : -1;

    for (int k = 0; k < n; k++)
        inside[k] = 1;
    for (int round = 1; m >= 0; round++) {
        m = 0;
        for (int k = 0; k < n; k++)
            if (inside[k]) {
                dx[k] = 0.0; /* what is left is the pull of those on their ends */
                kept[m++] = k;
            }
        for (int i = 0; i < m; i++) {
            for (int j = i; j < m; j++)
                factor[i * m + j] = precision[kept[i] * n + kept[j]];
            x[i] = (float)(m < n ? pull(n, precision, b, dx, kept[i]) : b[kept[i]]);
        }
        if (cholesky(m, factor, factors) < 0) {
            m = -1;
            break;
        }
        substitute(m, factor, x);
        for (int i = 0; i < m && m > 0; i++) {
            if (!isfinite(x[i]))
                m = -1;
            else
                dx[kept[i]] = x[i];
        }
        if (m < 0)
            break;
        int left = choose(n, precision, b, low, high, dx, inside, next);
        for (int k = 0; k < n; k++)
            dx[k] = fmin(fmax(dx[k], low[k]), high[k]);
        if (left < 0 || round == BOX_ROUNDS)
            break;
        if (left == 0) { /* all would be on their ends */
            memcpy(inside, next, n * sizeof *inside);
            if (choose(n, precision, b, low, high, dx, inside, next) < 0) {
                for (int i = 0; i < m; i++) /* and are: the factor is the last one's */
                    inside[kept[i]] = 1;
                break;
            }
        }
        memcpy(inside, next, n * sizeof *inside);
    }
    free(kept);
    free(x);
    return m;
}
