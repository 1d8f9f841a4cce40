/* The accelerated fixed point of a small skin: kernel.py says what it is, and has it in NumPy.
 *
 * NumPy's cost at this size is its calls, not its arithmetic: that is all there is to win here.
 * Pictures are (rows, cols), matrices row by row. Inner loops add multiples of rows to rows, which
 * compilers vectorise without being allowed to reorder sums.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { HISTORY = 6 }; /* earlier steps that are combined, as kernel.py's */

const unsigned source = SOURCE; /* checksum of this file, by which kernel.py knows it again */

static inline void add(double *restrict out, double factor, const double *restrict row, int n)
{
    for (int k = 0; k < n; k++)
        out[k] += factor * row[k];
}

static inline double dot(const double *a, const double *b, int n)
{
    double sum = 0.0;
    for (int k = 0; k < n; k++)
        sum += a[k] * b[k];
    return sum;
}

/* The inverse of a symmetric (n, n) matrix in its place (Gauss, Jordan); -1 if it is not positive
 * definite to rounding, or holds NaN. */
static inline int invert(double *a, int n, int stride)
{
    for (int p = 0; p < n; p++) {
        double *row = a + p * stride, scale = 1.0 / row[p];
        if (!(row[p] > 0.0))
            return -1;
        row[p] = 1.0;
        for (int k = 0; k < n; k++)
            row[k] *= scale;
        for (int i = 0; i < n; i++) {
            double factor = a[i * stride + p];
            if (i != p) {
                a[i * stride + p] = 0.0;
                add(a + i * stride, -factor, row, n);
            }
        }
    }
    return 0;
}

/* rho_ij = A_ii + D_jj - 2 C_ij of laplacian.py's blocks; -1 if the network is singular to rounding.
 * `space` holds rows * (rows + 2 cols) + 2 cols numbers. */
static inline int two_terminal(int rows, int cols, const double *g, double *rho, double *space)
{
    double *a = space, *turned = a + rows * rows, *scaled = turned + rows * cols;
    double *sum = scaled + rows * cols, *d = sum + cols, total = 0.0;

    memset(sum, 0, cols * sizeof *sum);
    for (int i = 0; i < rows; i++)
        add(sum, 1.0, g + i * cols, cols);
    for (int j = 0; j < cols; j++) {
        total += sum[j];
        d[j] = 1.0 / sum[j];
        for (int i = 0; i < rows; i++) {
            turned[j * rows + i] = g[i * cols + j];
            scaled[i * cols + j] = g[i * cols + j] / sum[j];
        }
    }
    for (int i = 0; i < rows; i++) { /* S, made regular */
        for (int k = 0; k < rows; k++)
            a[i * rows + k] = total / ((double)rows * rows);
        for (int j = 0; j < cols; j++) {
            a[i * rows + i] += g[i * cols + j];
            add(a + i * rows, -scaled[i * cols + j], turned + j * rows, rows);
        }
    }
    if (invert(a, rows, rows) < 0)
        return -1;
    memset(rho, 0, rows * cols * sizeof *rho);
    for (int i = 0; i < rows; i++) { /* C */
        double *c = rho + i * cols;
        for (int k = 0; k < rows; k++)
            add(c, a[i * rows + k], scaled + k * cols, cols);
        for (int j = 0; j < cols; j++)
            d[j] += scaled[i * cols + j] * c[j];
    }
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            rho[i * cols + j] = a[i * rows + i] + d[j] - 2.0 * rho[i * cols + j];
    return 0;
}

/* kernel.fixed_point over the n cells `at`: g becomes the last point. Returns the steps taken; -1:
 * NumPy has to do it, as the network is singular to rounding, say. */
int fixed_point(int rows, int cols, double *g, int n, const int *at, const double *measured,
                const double *low, const double *high, double r_ref, double r_par, double goal,
                int steps)
{
    size_t size = rows * (rows + 3 * cols) + 2 * cols + (2 * HISTORY + 4) * n;
    double *space = calloc(size, sizeof *space), gram[HISTORY * HISTORY] = {0.0};
    double *rho = space, *x = rho + rows * cols, *misfit = x + n, *last = misfit + n;
    double *image = last + n, *d_misfit = image + n, *d_image = d_misfit + HISTORY * n;
    double *rest = d_image + HISTORY * n;
    int step = space ? 0 : -1;

    for (int i = 0; i < n && step == 0; i++)
        if (at[i] < 0 || at[i] >= rows * cols)
            step = -1;
    for (int i = 0; i < n && step == 0; i++)
        x[i] = log(g[at[i]]);
    while (0 <= step && step < steps) {
        double missed = 0.0, trace = 0.0, inverse[HISTORY * HISTORY], pull[HISTORY];
        if (two_terminal(rows, cols, g, rho, rest) < 0) {
            step = -1;
            break;
        }
        for (int i = 0; i < n; i++) {
            double off = r_ref / (r_ref + r_par + rho[at[i]]) - r_ref / (r_ref + r_par + measured[i]);
            missed += off * off;
            misfit[i] = log(rho[at[i]] / measured[i]);
        }
        if (missed <= goal)
            break;
        int slot = (step + HISTORY - 1) % HISTORY, used = step < HISTORY ? step : HISTORY;
        for (int i = 0; i < n; i++) {
            double plain = x[i] + misfit[i]; /* the step that is not accelerated */
            d_misfit[slot * n + i] = misfit[i] - last[i];
            d_image[slot * n + i] = plain - image[i];
            last[i] = misfit[i];
            image[i] = x[i] = plain;
        }
        for (int a = 0; a < used; a++) {
            pull[a] = dot(d_misfit + a * n, misfit, n);
            gram[a * HISTORY + slot] = gram[slot * HISTORY + a]
                = dot(d_misfit + a * n, d_misfit + slot * n, n);
        }
        for (int a = 0; a < used; a++)
            trace += gram[a * HISTORY + a];
        memcpy(inverse, gram, sizeof gram);
        for (int a = 0; a < used; a++)
            inverse[a * HISTORY + a] += 1e-10 * trace + 1e-30;
        if (invert(inverse, used, HISTORY) < 0) {
            step = -1;
            break;
        }
        for (int a = 0; a < used; a++)
            add(x, -dot(inverse + a * HISTORY, pull, used), d_image + a * n, n);
        for (int i = 0; i < n; i++) {
            x[i] = x[i] < low[i] ? low[i] : x[i] > high[i] ? high[i] : x[i]; /* NaN stays NaN */
            g[at[i]] = exp(x[i]);
        }
        step++;
    }
    free(space);
    return step;
}
