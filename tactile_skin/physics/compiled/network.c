/* SPDX-License-Identifier: Apache-2.0 */
/* What follows from the conductances of a small skin: ../laplacian.py says what each is, and
 * ../kernel.py the fixed point; both hold the same in NumPy.
 *
 * NumPy's cost at this size is its calls, not its arithmetic: that is all there is to win here.
 * Pictures are (rows, cols), matrices row by row, lines = rows + cols. Functions return -1 where
 * NumPy has to do it: the network is singular to rounding, holds NaN, or there is no memory.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { HISTORY = 6 }; /* earlier steps that are combined, as kernel.py's */

const unsigned source = SOURCE; /* checksum of the C files, by which they are known again */

/* out[k] += the sum over m rows of factors[j] rows[j][k], n of each, rows `stride` apart. */
static inline void combine(double *restrict out, int n, const double *restrict factors,
                           const double *restrict rows, int stride, int m)
{
    int j = 0;

    for (; j + 4 <= m; j += 4) {
        const double a = factors[j], b = factors[j + 1], c = factors[j + 2], d = factors[j + 3];
        const double *one = rows + j * stride, *two = rows + (j + 1) * stride;
        const double *three = rows + (j + 2) * stride, *four = rows + (j + 3) * stride;
        for (int k = 0; k < n; k++)
            out[k] += (a * one[k] + b * two[k]) + (c * three[k] + d * four[k]);
    }
    for (; j < m; j++)
        for (int k = 0; k < n; k++)
            out[k] += factors[j] * rows[j * stride + k];
}

static inline double dot(const double *a, const double *b, int n)
{
    double even = 0.0, odd = 0.0; /* a sum would wait for each addition */
    int k = 0;

    for (; k + 2 <= n; k += 2) {
        even += a[k] * b[k];
        odd += a[k + 1] * b[k + 1];
    }
    return k < n ? even + odd + a[k] * b[k] : even + odd;
}

/* Of the shorter side's lines, here its rows; the longer side's are eliminated. */
typedef struct {
    int rows, cols, first, second; /* where the rows' lines begin, and the columns' */
    int down, right;               /* steps in the caller's picture */
    double *scaled;  /* (rows, cols) g D_c^-1 */
    double *col_sum; /* (cols,) D_c */
    double *root;    /* (rows, rows) upper R with A = R R^T */
    double *turned;  /* (rows, rows) its transpose */
    double *a, *c;   /* (rows, rows), (rows, cols): blocks of K */
    double *s;       /* (rows, rows) the network seen from the rows, then its factor */
    double *turned_g, *factors, *d;
} Network;

/* Room for a network and `more` numbers, which come first: to be freed; NULL: there is none. */
static double *room(int rows, int cols, size_t more, Network *n)
{
    int tall = rows > cols, lines = rows + cols, cells = rows * cols;
    int side = tall ? cols : rows, square = side * side;
    double *space = calloc(more + 3 * cells + 4 * square + 3 * lines, sizeof *space);

    if (space) {
        n->rows = side;
        n->cols = lines - side;
        n->first = tall ? rows : 0;
        n->second = tall ? 0 : rows;
        n->down = tall ? 1 : cols;
        n->right = tall ? cols : 1;
        n->scaled = space + more;
        n->turned_g = n->scaled + cells;
        n->c = n->turned_g + cells;
        n->root = n->c + cells;
        n->turned = n->root + square;
        n->a = n->turned + square;
        n->s = n->a + square;
        n->col_sum = n->s + square;
        n->factors = n->col_sum + lines;
        n->d = n->factors + lines;
    }
    return space;
}

/* A and C, the first two blocks of K, and what leads to them. */
static int blocks(const double *restrict g, const Network *n)
{
    int rows = n->rows, cols = n->cols;
    double *s = n->s, *factors = n->factors, total = 0.0;

    memset(n->col_sum, 0, cols * sizeof *n->col_sum);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            double here = g[i * n->down + j * n->right];
            n->col_sum[j] += here;
            n->scaled[i * cols + j] = n->turned_g[j * rows + i] = here;
        }
    for (int j = 0; j < cols; j++) {
        total += n->col_sum[j];
        n->d[j] = 1.0 / n->col_sum[j];
    }
    for (int i = 0; i < rows; i++) { /* S, made regular: its upper triangle */
        double *row = s + i * rows, sum = 0.0;
        for (int j = 0; j < cols; j++) {
            sum += n->scaled[i * cols + j];
            n->scaled[i * cols + j] *= n->d[j];
            factors[j] = -n->scaled[i * cols + j];
        }
        for (int k = i; k < rows; k++)
            row[k] = total / ((double)rows * rows);
        row[i] += sum;
        combine(row + i, rows - i, factors, n->turned_g + i, rows, cols);
    }
    for (int i = 0; i < rows; i++) { /* S = U^T U and U^T R^T = 1, row by row */
        double *row = s + i * rows, *turned = n->turned + i * rows;
        for (int j = 0; j < i; j++)
            factors[j] = -s[j * rows + i];
        for (int k = 0; k < rows; k++)
            turned[k] = k == i;
        combine(row + i, rows - i, factors, s + i, rows, i);
        combine(turned, i, factors, n->turned, rows, i);
        if (!(row[i] > 0.0))
            return -1;
        double scale = 1.0 / sqrt(row[i]);
        for (int k = i; k < rows; k++)
            row[k] *= scale;
        for (int k = 0; k <= i; k++) {
            turned[k] *= scale;
            n->root[k * rows + i] = turned[k];
        }
    }
    for (int i = 0; i < rows; i++) {
        double *a = n->a + i * rows;
        memset(a, 0, rows * sizeof *a);
        combine(a, i + 1, n->root + i * rows + i, n->turned + i * rows, rows, rows - i);
        for (int k = 0; k < i; k++)
            n->a[k * rows + i] = a[k];
    }
    memset(n->c, 0, rows * cols * sizeof *n->c);
    for (int i = 0; i < rows; i++)
        combine(n->c + i * cols, cols, n->a + i * rows, n->scaled, cols, rows);
    return 0;
}

/* rho_ij = A_ii + D_jj - 2 C_ij; changes n->d. */
static void two_terminal(const Network *n, double *restrict rho)
{
    int rows = n->rows, cols = n->cols;
    double *d = n->d;

    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            d[j] += n->scaled[i * cols + j] * n->c[i * cols + j];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            rho[i * n->down + j * n->right] = n->a[i * rows + i] + d[j] - 2.0 * n->c[i * cols + j];
}

/* k, (lines, lines), comes as zeros; log_det is that of its determinant. */
int solve(int rows, int cols, const double *g, double *log_det, double *k, double *rho)
{
    Network n;
    double *space = room(rows, cols, 0, &n);
    int lines = rows + cols, failed = space ? blocks(g, &n) : -1;

    *log_det = 0.0;
    for (int i = 0; !failed && i < n.rows; i++) {
        double *k_row = k + (n.first + i) * lines;
        *log_det += 2.0 * log(n.root[i * n.rows + i]);
        memcpy(k_row + n.first, n.a + i * n.rows, n.rows * sizeof *k);
        memcpy(k_row + n.second, n.c + i * n.cols, n.cols * sizeof *k);
        for (int j = 0; j < n.cols; j++)
            k[(n.second + j) * lines + n.first + i] = n.c[i * n.cols + j];
    }
    for (int j = 0; !failed && j < n.cols; j++) {
        double *k_row = k + (n.second + j) * lines + n.second;
        *log_det -= log(n.col_sum[j]);
        for (int i = 0; i < n.rows; i++)
            n.factors[i] = n.scaled[i * n.cols + j];
        combine(k_row, n.cols, n.factors, n.c, n.cols, n.rows);
        k_row[j] += 1.0 / n.col_sum[j];
    }
    if (!failed)
        two_terminal(&n, rho);
    free(space);
    return failed;
}

/* sum_b t_ab^2 p_b: K L(p) K between a's two lines. */
int hessian_product(int rows, int cols, const double *k, const double *p, double *out)
{
    int lines = rows + cols;
    double *image = calloc(lines * (lines + 2), sizeof *image); /* L(p) K */
    double *own = image + lines * lines, *factors = own + lines; /* own: diagonal of K L(p) K */

    if (!image)
        return -1;
    for (int i = 0; i < lines; i++) {
        int is_row = i < rows, n = is_row ? cols : rows, first = is_row ? rows : 0;
        double sum = 0.0, *row = image + i * lines;
        for (int j = 0; j < n; j++) {
            factors[j] = is_row ? -p[i * cols + j] : -p[j * cols + i - rows];
            sum -= factors[j];
        }
        combine(row, lines, &sum, k + i * lines, lines, 1);
        combine(row, lines, factors, k + first * lines, lines, n);
    }
    for (int l = 0; l < lines; l++) /* K is symmetric */
        for (int i = 0; i < lines; i++)
            own[i] += k[l * lines + i] * image[l * lines + i];
    memset(out, 0, rows * cols * sizeof *out);
    for (int i = 0; i < rows; i++) {
        combine(out + i * cols, cols, k + i * lines, image + rows, lines, lines);
        for (int j = 0; j < cols; j++)
            out[i * cols + j] = own[i] + own[rows + j] - 2.0 * out[i * cols + j];
    }
    free(image);
    return 0;
}

/* The (n, n) system s x = b of a positive definite s, both overwritten; rows HISTORY apart. */
static int solve_small(double *s, double *b, int n)
{
    for (int i = 0; i < n; i++) {
        if (!(s[i * HISTORY + i] > 0.0))
            return -1;
        for (int j = i + 1; j < n; j++) {
            double factor = s[j * HISTORY + i] / s[i * HISTORY + i];
            for (int k = i; k < n; k++)
                s[j * HISTORY + k] -= factor * s[i * HISTORY + k];
            b[j] -= factor * b[i];
        }
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= s[i * HISTORY + k] * b[k];
        b[i] /= s[i * HISTORY + i];
    }
    return 0;
}

/* kernel.fixed_point over the n cells `at`: g becomes the last point. Returns the steps taken. */
int fixed_point(int rows, int cols, double *g, int n, const int *at, const double *measured,
                const double *low, const double *high, double r_ref, double r_par, double goal,
                int steps)
{
    Network network;
    double *space = room(rows, cols, rows * cols + (2 * HISTORY + 4) * (size_t)n, &network);
    double *rho = space, *x = rho + rows * cols, *misfit = x + n, *last = misfit + n;
    double *image = last + n, *d_misfit = image + n, *d_image = d_misfit + HISTORY * n;
    double gram[HISTORY * HISTORY] = {0.0};
    int step = space ? 0 : -1;

    for (int i = 0; i < n && step == 0; i++)
        if (at[i] < 0 || at[i] >= rows * cols)
            step = -1;
    for (int i = 0; i < n && step == 0; i++)
        x[i] = log(g[at[i]]);
    while (0 <= step && step < steps) {
        double missed = 0.0, trace = 0.0, matrix[HISTORY * HISTORY], share[HISTORY];
        if (blocks(g, &network) < 0) {
            step = -1;
            break;
        }
        two_terminal(&network, rho);
        for (int i = 0; i < n; i++) {
            double off = r_ref / (r_ref + r_par + rho[at[i]]) - r_ref / (r_ref + r_par + measured[i]);
            missed += off * off;
        }
        if (missed <= goal)
            break;
        for (int i = 0; i < n; i++)
            misfit[i] = log(rho[at[i]] / measured[i]);
        int slot = (step + HISTORY - 1) % HISTORY, used = step < HISTORY ? step : HISTORY;
        for (int i = 0; i < n; i++) {
            double plain = x[i] + misfit[i]; /* the step that is not accelerated */
            d_misfit[slot * n + i] = misfit[i] - last[i];
            d_image[slot * n + i] = plain - image[i];
            last[i] = misfit[i];
            image[i] = x[i] = plain;
        }
        for (int a = 0; a < used; a++) {
            share[a] = dot(d_misfit + a * n, misfit, n);
            gram[a * HISTORY + slot] = gram[slot * HISTORY + a]
                = dot(d_misfit + a * n, d_misfit + slot * n, n);
        }
        for (int a = 0; a < used; a++)
            trace += gram[a * HISTORY + a];
        memcpy(matrix, gram, sizeof gram);
        for (int a = 0; a < used; a++)
            matrix[a * HISTORY + a] += 1e-10 * trace + 1e-30;
        if (solve_small(matrix, share, used) < 0) {
            step = -1;
            break;
        }
        for (int a = 0; a < used; a++)
            share[a] = -share[a];
        combine(x, n, share, d_image, n, used);
        for (int i = 0; i < n; i++)
            x[i] = x[i] < low[i] ? low[i] : x[i] > high[i] ? high[i] : x[i]; /* NaN stays NaN */
        for (int i = 0; i < n; i++)
            g[at[i]] = exp(x[i]);
        step++;
    }
    free(space);
    return step;
}
