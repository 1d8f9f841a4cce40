/* SPDX-License-Identifier: Apache-2.0 */
/* The parts of a step of `map`: the prior (../../solvers/prior.py) and the programme within bounds
 * (../quadratic.py), which hold the same in NumPy. Functions return -1 where NumPy has to do it.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BOX_ROUNDS = 8, FEW_HELD = 4 }; /* as quadratic.py's */

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

/* x <- U^-T x, which is 0 before `first`. */
static void forward(int m, const float *restrict upper, float *restrict x, int first)
{
    for (int i = first; i < m; i++) {
        const float *row = upper + i * m;
        float here = x[i] /= row[i];
        for (int k = i + 1; k < m; k++)
            x[k] -= here * row[k];
    }
}

static float dot(const float *restrict a, const float *restrict b, int n)
{
    float sum[8] = {0.0f};
    int k = 0;

    for (; k + 8 <= n; k += 8)
        for (int q = 0; q < 8; q++)
            sum[q] += a[k + q] * b[k + q];
    for (; k < n; k++)
        sum[0] += a[k] * b[k];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7]));
}

/* x <- U^-1 x */
static void backward(int m, const float *restrict upper, float *restrict x)
{
    for (int i = m - 1; i >= 0; i--)
        x[i] = (x[i] - dot(upper + i * m + i + 1, x + i + 1, m - i - 1)) / upper[i * m + i];
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

/* quadratic.solve_in_box: fills dx (zeros before), and which unknowns stayed inside. first: NULL, or
 * the factor over all. Returns the number that the last factor is over; -1: there is none. */
int solve_in_box(int n, const float *precision, const float *first, const double *b,
                 const double *low, const double *high, double *dx, int *inside)
{
    /* kept: the m unknowns that the factor is over; at: their places, from 1; held: h of them */
    int *kept = calloc(5 * n + 1, sizeof *kept), *at = kept + n, *held = at + n;
    int *next = held + n, *then = next + n, m = 0;
    size_t most = n / FEW_HELD + 1;
    float *own = malloc((n * (n + 3) + most * (n + most)) * sizeof *own);
    float *x = own + n * n, *half = x + n, *factors = half + n, *moved = factors + n;
    float *between = moved + most * n;
    const float *factor = own;

    for (int k = 0; k < n; k++)
        inside[k] = 1;
    for (int round = 1; kept && own; round++) {
        int h = 0, joins = m == 0;
        for (int k = 0; k < n; k++) {
            joins |= inside[k] && !at[k];
            if (at[k] && !inside[k])
                held[h++] = at[k] - 1;
        }
        if (joins || h * FEW_HELD > m) {
            m = h = 0;
            for (int k = 0; k < n; k++) {
                at[k] = inside[k] ? m + 1 : 0;
                if (inside[k]) {
                    dx[k] = 0.0; /* what is left is the pull of those on their ends */
                    kept[m++] = k;
                }
            }
            factor = m == n && first ? first : own;
            for (int i = 0; i < m; i++) {
                for (int j = i; j < m && factor == own; j++)
                    own[i * m + j] = precision[kept[i] * n + kept[j]];
                half[i] = (float)(m < n ? pull(n, precision, b, dx, kept[i]) : b[kept[i]]);
            }
            if (factor == own && cholesky(m, own, factors) < 0) {
                m = -1;
                break;
            }
            forward(m, factor, half, 0);
        }
        for (int i = 0; i < h; i++) { /* what holds them moves the others: no other factor */
            float *row = moved + i * m;
            memset(row, 0, m * sizeof *row);
            row[held[i]] = 1.0f;
            forward(m, factor, row, held[i]);
            for (int j = 0; j <= i; j++)
                between[j * h + i] = dot(row, moved + j * m, m);
            factors[i] = (float)dx[kept[held[i]]] - dot(row, half, m);
        }
        if (h && cholesky(h, between, x) < 0) {
            m = -1;
            break;
        }
        memcpy(x, half, m * sizeof *x);
        if (h) {
            forward(h, between, factors, 0);
            backward(h, between, factors);
            combine(x, m, factors, moved, m, h);
        }
        backward(m, factor, x);
        for (int i = 0; i < m && m > 0; i++) {
            if (!isfinite(x[i]))
                m = -1;
            else if (inside[kept[i]])
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
            if (choose(n, precision, b, low, high, dx, next, then) < 0)
                break; /* and are */
            memcpy(next, then, n * sizeof *next);
        }
        memcpy(inside, next, n * sizeof *inside);
    }
    m = kept && own ? m : -1;
    free(kept);
    free(own);
    return m;
}
