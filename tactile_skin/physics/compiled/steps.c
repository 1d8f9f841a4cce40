/* SPDX-License-Identifier: Apache-2.0 */
/* The matrices of a step: the normal equations (../../solvers/reading.py) and the programme within
 * bounds (../quadratic.py), which hold the same in NumPy. All of it is one product whose sums stay
 * in registers. Functions return -1 where NumPy has to do it.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BOX_ROUNDS = 8, FEW_HELD = 4 }; /* as quadratic.py's */
enum { AT_ONCE = 64 };                 /* readings of a Jacobian */
#ifdef __AVX__
enum { TALL = 4, WIDE = 16 }; /* rows and columns of a product that registers hold */
#else
enum { TALL = 4, WIDE = 8 };
#endif
typedef float Lanes __attribute__((vector_size(WIDE / 2 * sizeof(float)), aligned(4), may_alias));

#define ROUNDED 1e-6f /* as quadratic.py's */

/* out[i][k] -= the sum over m of left[j][i] right[j][k], of rows x cols; each has its stride. */
static void subtract_product(int rows, int cols, int m, const float *restrict left, int ls,
                             const float *restrict right, int rs, float *restrict out, int os)
{
    for (int k = 0; k < cols; k += WIDE)
        for (int i = 0; i < rows; i += TALL) {
            int tall = rows - i < TALL ? rows - i : TALL, wide = cols - k < WIDE ? cols - k : WIDE;
            const float *l = left + i, *r = right + k;
            if (tall == TALL && wide == WIDE) {
                Lanes sum[TALL][2] = {{{0.0f}}}; /* in registers */
                for (int j = 0; j < m; j++, l += ls, r += rs) {
                    const Lanes one = *(const Lanes *)r, two = *(const Lanes *)(r + WIDE / 2);
                    for (int p = 0; p < TALL; p++) {
                        sum[p][0] += l[p] * one;
                        sum[p][1] += l[p] * two;
                    }
                }
                for (int p = 0; p < TALL; p++)
                    for (int q = 0; q < 2; q++)
                        *(Lanes *)(out + (i + p) * os + k + q * WIDE / 2) -= sum[p][q];
            } else
                for (int p = 0; p < tall; p++)
                    for (int j = 0; j < m; j++)
                        for (int q = 0; q < wide; q++)
                            out[(i + p) * os + k + q] -= l[j * ls + p] * r[j * rs + q];
        }
}

/* Give one of the lines without an unknown the squared weights of all: they read alike. */
static void group(int lines, int across, int line_step, int step, unsigned char *kept, double *square)
{
    int count = 0, one = -1;

    for (int i = 0; i < lines; i++)
        count += !kept[i];
    for (int i = 0, seen = 0; i < lines; i++)
        if (!kept[i] && seen++ == count / 2)
            one = i;
    for (int i = 0; one >= 0 && i < lines; i++)
        for (int j = 0; !kept[i] && i != one && j < across; j++)
            square[one * line_step + j * step] += square[i * line_step + j * step];
    if (one >= 0)
        kept[one] = 1;
}

/* J^T J (n, n), its upper triangle, of d reading_a / d x_b = weight_a slope_a t_ab^2 scale_b over
 * the cells `at`, by the few readings that say of these what all do (reading.Linearised.grouped).
 * -1: there are no such cells. */
int information(int rows, int cols, const double *k, const double *weight, const double *slope,
                const double *scale, int n, const int *at, float *out)
{
    int lines = rows + cols, cells = rows * cols, failed = 0;
    int wide = ((n + WIDE - 1) / WIDE | 1) * WIDE; /* odd: rows share no places of a cache */
    int *one = malloc((2 * n + 1) * sizeof *one), *other = one + n;
    float *across = calloc((size_t)(lines + 1 + AT_ONCE + wide) * wide + 1, sizeof *across);
    float *by = across + (size_t)lines * wide, *part = by + wide, *sum = part + AT_ONCE * wide;
    double *square = malloc(cells * sizeof *square);
    unsigned char *kept = calloc(lines + 1, 1);

    for (int b = 0; b < n; b++)
        failed |= at[b] < 0 || at[b] >= cells;
    if (one && across && square && kept && !failed) {
        for (int b = 0; b < n; b++) {
            one[b] = at[b] / cols;
            other[b] = rows + at[b] % cols;
            kept[one[b]] = kept[other[b]] = 1;
            by[b] = (float)scale[at[b]];
        }
        for (int l = 0; l < lines; l++)
            for (int b = 0; b < n; b++)
                across[l * wide + b] = (float)(k[l * lines + one[b]] - k[l * lines + other[b]]);
        for (int a = 0; a < cells; a++)
            square[a] = weight[a] * weight[a];
        group(rows, cols, cols, 1, kept, square);
        group(cols, rows, 1, cols, kept + rows, square);
        for (int a = 0, some = 0; a < cells; a++) {
            if (kept[a / cols] && kept[rows + a % cols] && square[a] > 0.0) {
                const float *row = across + a / cols * wide, *col = across + (rows + a % cols) * wide;
                float w = (float)(sqrt(square[a]) * slope[a]), *here = part + some++ * wide;
                for (int b = 0; b < n; b++)
                    here[b] = w * ((row[b] - col[b]) * (row[b] - col[b])) * by[b];
            }
            if (some < AT_ONCE && a + 1 < cells)
                continue;
            for (int i = 0; i < wide; i += TALL)
                subtract_product(TALL, wide - i / WIDE * WIDE, some, part + i, wide,
                                 part + i / WIDE * WIDE, wide, sum + i * wide + i / WIDE * WIDE, wide);
            some = 0;
        }
        for (int i = 0; i < n; i++)
            for (int j = i; j < n; j++)
                out[i * n + j] = -sum[i * wide + j];
    } else
        failed = 1;
    free(one);
    free(across);
    free(square);
    free(kept);
    return -failed;
}

/* M = U^T U, U in the upper triangle; -1 if M is not positive definite, or holds NaN. What lies
 * below is lost. */
static int cholesky(int m, float *matrix)
{
    for (int first = 0; first < m; first += TALL) {
        int end = first + TALL < m ? first + TALL : m;
        subtract_product(end - first, m - first, first, matrix + first, m, matrix + first, m,
                         matrix + first * m + first, m);
        for (int i = first; i < end; i++) {
            float *row = matrix + i * m;
            if (!(row[i] > 0.0f) || !(row[i] < INFINITY))
                return -1;
            float scale = 1.0f / sqrtf(row[i]);
            for (int k = i; k < m; k++)
                row[k] *= scale;
            for (int j = i + 1; j < end; j++)
                for (int k = j; k < m; k++)
                    matrix[j * m + k] -= row[j] * row[k];
        }
    }
    return 0;
}

/* X <- U^-T X of n columns; rows of U are `us` apart, of X `stride`. */
static void forward(int m, const float *restrict upper, int us, int n, float *restrict x,
                    int stride)
{
    for (int first = 0; first < m; first += TALL) {
        int end = first + TALL < m ? first + TALL : m;
        subtract_product(end - first, n, first, upper + first, us, x, stride, x + first * stride,
                         stride);
        for (int i = first; i < end; i++) {
            float *row = x + i * stride, scale = 1.0f / upper[i * us + i];
            for (int k = 0; k < n; k++)
                row[k] *= scale;
            for (int j = i + 1; j < end; j++)
                for (int k = 0; k < n; k++)
                    x[j * stride + k] -= upper[i * us + j] * row[k];
        }
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

/* quadratic.inverse over the m unknowns `kept`: out (m, m), its upper triangle. -1: there is none. */
int inverse(int n, const float *precision, int m, const int *kept, float *out)
{
    int wide = ((m + WIDE - 1) / WIDE | 1) * WIDE, failed = 0;
    float *factor = malloc(((size_t)m * m + 1) * sizeof *factor);
    float *root = calloc((size_t)(m + wide) * wide, sizeof *root), *sum = root + m * wide; /* U^-T */

    for (int i = 0; i < m; i++)
        failed |= kept[i] < 0 || kept[i] >= n || (i && kept[i] <= kept[i - 1]);
    failed |= !factor || !root;
    for (int i = 0; i < m && !failed; i++)
        for (int j = i; j < m; j++)
            factor[i * m + j] = precision[kept[i] * n + kept[j]];
    failed = failed || cholesky(m, factor) < 0;
    for (int c = 0; c < m && !failed; c += WIDE) {
        float *part = root + c * wide + c;
        for (int k = 0; k < WIDE && c + k < m; k++)
            part[k * wide + k] = 1.0f;
        forward(m - c, factor + c * m + c, m, WIDE, part, wide);
        subtract_product(c + WIDE, WIDE, m - c, part - c, wide, part, wide, sum + c, wide);
    }
    for (int i = 0; i < m && !failed; i++)
        for (int j = i; j < m; j++)
            out[i * m + j] = -sum[i * wide + j];
    free(factor);
    free(root);
    return -failed;
}

/* left = b - precision dx, of an upper triangle; x: room for dx. */
static void pull(int n, const float *precision, const double *b, const double *dx, float *x,
                 float *left)
{
    for (int k = 0; k < n; k++) {
        left[k] = (float)b[k];
        x[k] = (float)dx[k];
    }
    for (int i = 0; i < n; i++) {
        const float *row = precision + i * n, here = x[i];
        left[i] -= dot(row + i, x + i, n - i);
        for (int k = i + 1; k < n && here != 0.0f; k++)
            left[k] -= here * row[k];
    }
}

/* quadratic._inside_next. Returns how many are inside, or -1: the same as before. */
static int choose(int n, const float *precision, const double *b, const double *low,
                  const double *high, const double *dx, const int *inside, int *next, float *x, float *left)
{
    int changed = 0, count = 0;
    float least = 0.0f;

    for (int k = 0; k < n; k++)
        least = fmaxf(least, ROUNDED * fabsf((float)b[k]));
    pull(n, precision, b, dx, x, left);
    for (int k = 0; k < n; k++) {
        next[k] = inside[k] && dx[k] >= low[k] && dx[k] <= high[k];
        if (!inside[k] && low[k] < high[k])
            next[k] = dx[k] == low[k] ? left[k] > least : left[k] < -least;
        changed += next[k] != inside[k];
        count += next[k];
    }
    return changed ? count : -1;
}

/* quadratic.solve_in_box: fills dx (zeros before), and which unknowns stayed inside (ones before).
 * Returns the number that the last factor is over; -1: there is none. */
int solve_in_box(int n, const float *precision, const double *b, const double *low,
                 const double *high, double *dx, int *inside)
{
    /* kept: the m unknowns that the factor is over; at: their places, from 1; held: h of them. Of
     * `sides`, U^-T of the right side and of a unit vector for each that was held, `column` says
     * which; `products` are theirs with one another, times -1. */
    int *kept = calloc(6 * n + 1, sizeof *kept), *at = kept + n, *held = at + n;
    int *next = held + n, *then = next + n, *column = then + n, m = 0, used = 0;
    int most = n / FEW_HELD + 2, wide = ((most / WIDE + 2) | 1) * WIDE;
    float *factor = malloc(((size_t)n * (n + 2) + (size_t)wide * (n + 2 * wide + 2)) * sizeof *factor);
    float *x = factor + n * n, *left = x + n, *sides = left + n, *products = sides + n * wide;
    float *between = products + wide * wide, *right = between + wide * wide, *share = right + wide;

    for (int round = 1; kept && factor; round++) {
        int h = 0, joins = m == 0, more = 0;
        for (int k = 0; k < n; k++) {
            joins |= inside[k] && !at[k];
            if (at[k] && !inside[k]) {
                held[h++] = k;
                more += !column[k];
            }
        }
        if (joins || h * FEW_HELD > m || used + more > most) {
            m = h = used = 0;
            for (int k = 0; k < n; k++) {
                at[k] = inside[k] ? m + 1 : 0;
                column[k] = 0;
                if (inside[k]) {
                    dx[k] = 0.0; /* what is left is the pull of those on their ends */
                    kept[m++] = k;
                }
            }
            pull(n, precision, b, dx, x, left);
            for (int i = 0; i < m; i++)
                for (int j = i; j < m; j++)
                    factor[i * m + j] = precision[kept[i] * n + kept[j]];
            memset(sides, 0, (size_t)n * wide * sizeof *sides);
            memset(products, 0, (size_t)wide * wide * sizeof *products);
            if (cholesky(m, factor) < 0) {
                m = -1;
                break;
            }
            for (int i = 0; i < m; i++)
                sides[i * wide] = left[kept[i]];
        }
        int fresh = used;
        used += used == 0; /* the right side's */
        for (int i = 0; i < h; i++)
            if (!column[held[i]]) {
                sides[(at[held[i]] - 1) * wide + used] = 1.0f;
                column[held[i]] = used++;
            }
        if (fresh < used) {
            int columns = (used - fresh + WIDE - 1) / WIDE * WIDE; /* those past `used` are zeros */
            forward(m, factor, m, columns, sides + fresh, wide);
            subtract_product((used + TALL - 1) / TALL * TALL, columns, m, sides, wide,
                             sides + fresh, wide, products + fresh, wide);
        }
        for (int i = 0; i < h; i++) { /* what holds them moves the others: no other factor */
            int here = column[held[i]];
            share[i] = (float)dx[held[i]] + products[here];
            for (int j = 0; j <= i; j++) {
                int there = column[held[j]], first = here < there ? here : there;
                between[j * h + i] = -products[first * wide + here + there - first];
            }
        }
        if (cholesky(h, between) < 0) {
            m = -1;
            break;
        }
        forward(h, between, h, 1, share, 1);
        backward(h, between, share);
        memset(right, 0, wide * sizeof *right);
        right[0] = 1.0f;
        for (int i = 0; i < h; i++)
            right[column[held[i]]] = share[i];
        for (int i = 0; i < m; i++)
            x[i] = dot(sides + i * wide, right, used);
        backward(m, factor, x);
        for (int i = 0; i < m && m > 0; i++) {
            if (!isfinite(x[i]))
                m = -1;
            else if (inside[kept[i]])
                dx[kept[i]] = x[i];
        }
        if (m < 0)
            break;
        int count = choose(n, precision, b, low, high, dx, inside, next, x, left);
        for (int k = 0; k < n; k++)
            dx[k] = fmin(fmax(dx[k], low[k]), high[k]);
        if (count < 0 || round == BOX_ROUNDS)
            break;
        if (count == 0) { /* all would be on their ends */
            if (choose(n, precision, b, low, high, dx, next, then, x, left) < 0)
                break; /* and are */
            memcpy(next, then, n * sizeof *next);
        }
        memcpy(inside, next, n * sizeof *inside);
    }
    m = kept && factor ? m : -1;
    free(kept);
    free(factor);
    return m;
}
