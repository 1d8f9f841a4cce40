/* What runs in every step of every iteration, for one frame of at most LINES stripes.
 *
 * circuit.py, solvers/laplacian.py and solvers/prior.py say what each function is, hold the same in
 * NumPy, and use that for larger skins and where no compiler was found. NumPy's cost at this size
 * is its calls, not its arithmetic: that is all there is to win here, a factor of 5 to 10.
 *
 * All arrays are C-contiguous doubles (indices: int32, not checked), made by the caller. Inner loops add
 * multiples of rows to rows, which compilers vectorise without being allowed to reorder sums.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

#define LINES 64
#define CELLS (LINES * LINES / 4)

/* AVX2 where the processor has it: the package is built for any. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORISED __attribute__((target_clones("avx2,fma", "default")))
#else
#define VECTORISED
#endif

/* --- the network ------------------------------------------------------------------------------ */

typedef struct {
    double scaled[CELLS];      /* (rows, cols) g D_c^-1 */
    double col_sum[LINES];     /* D_c */
    double root[LINES * LINES]; /* (rows, rows) upper R with A = R R^T; its transpose is `turned` */
    double turned[LINES * LINES];
    double a[LINES * LINES];   /* (rows, rows) */
    double c[CELLS];           /* (rows, cols) */
    double d[LINES * LINES];   /* (cols, cols) */
} Network;

/* R of circuit.reduced_root; -1 if S is singular to rounding, or holds NaN. */
VECTORISED static int reduced_root(const double *restrict g, int rows, int cols,
                                   Network *restrict n)
{
    double turned_g[CELLS], row_sum[LINES], s[LINES * LINES], total = 0.0;

    for (int j = 0; j < cols; j++)
        n->col_sum[j] = 0.0;
    for (int i = 0; i < rows; i++) {
        row_sum[i] = 0.0;
        for (int j = 0; j < cols; j++) {
            row_sum[i] += g[i * cols + j];
            n->col_sum[j] += g[i * cols + j];
            turned_g[j * rows + i] = g[i * cols + j];
        }
        total += row_sum[i];
    }
    double fill = total / ((double)rows * rows);
    for (int i = 0; i < rows; i++) {
        double *restrict row = s + i * rows;
        for (int k = 0; k < rows; k++)
            row[k] = fill;
        row[i] += row_sum[i];
        for (int j = 0; j < cols; j++) {
            double share = n->scaled[i * cols + j] = g[i * cols + j] / n->col_sum[j];
            const double *restrict other = turned_g + j * rows;
            for (int k = 0; k < rows; k++)
                row[k] -= share * other[k];
        }
    }
    /* S = U^T U, U in the upper triangle of s */
    for (int i = 0; i < rows; i++) {
        double pivot = s[i * rows + i];
        if (!(pivot > 0.0))
            return -1;
        double scale = 1.0 / sqrt(pivot);
        for (int k = i; k < rows; k++)
            s[i * rows + k] *= scale;
        for (int j = i + 1; j < rows; j++) {
            double factor = s[i * rows + j];
            for (int k = j; k < rows; k++)
                s[j * rows + k] -= factor * s[i * rows + k];
        }
    }
    /* R = U^-1, row by row of its transpose: (U^T) R^T = 1 */
    for (int i = 0; i < rows; i++) {
        double *restrict row = n->turned + i * rows;
        for (int k = 0; k < rows; k++)
            row[k] = 0.0;
        row[i] = 1.0;
        for (int j = 0; j < i; j++) {
            double factor = s[j * rows + i];
            for (int k = 0; k <= j; k++)
                row[k] -= factor * n->turned[j * rows + k];
        }
        double scale = 1.0 / s[i * rows + i];
        for (int k = 0; k <= i; k++)
            row[k] *= scale;
    }
    for (int i = 0; i < rows; i++)
        for (int k = 0; k < rows; k++)
            n->root[i * rows + k] = n->turned[k * rows + i];
    return 0;
}

/* A and C, the first two blocks of K. */
VECTORISED static void blocks(int rows, int cols, Network *restrict n)
{
    for (int i = 0; i < rows; i++) {
        double *restrict a = n->a + i * rows, *restrict c = n->c + i * cols;
        for (int k = 0; k < rows; k++)
            a[k] = 0.0;
        for (int j = i; j < rows; j++)
            for (int k = 0; k <= j; k++)
                a[k] += n->root[i * rows + j] * n->turned[j * rows + k];
        for (int k = 0; k < cols; k++)
            c[k] = 0.0;
        for (int j = 0; j < rows; j++)
            for (int k = 0; k < cols; k++)
                c[k] += a[j] * n->scaled[j * cols + k];
    }
}

/* K, (lines, lines), and its root W, of laplacian.Network. */
VECTORISED static void whole(int rows, int cols, Network *restrict n, double *restrict root,
                             double *restrict k)
{
    int lines = rows + cols;

    for (int j = 0; j < cols; j++) {
        double *restrict d = n->d + j * cols;
        for (int l = 0; l < cols; l++)
            d[l] = 0.0;
        for (int i = 0; i < rows; i++)
            for (int l = 0; l < cols; l++)
                d[l] += n->scaled[i * cols + j] * n->c[i * cols + l];
        d[j] += 1.0 / n->col_sum[j];
    }
    for (int i = 0; i < lines * lines; i++)
        root[i] = 0.0;
    for (int i = 0; i < rows; i++) {
        for (int l = 0; l < rows; l++) {
            root[i * lines + l] = n->root[i * rows + l];
            k[i * lines + l] = n->a[i * rows + l];
        }
        for (int j = 0; j < cols; j++)
            k[i * lines + rows + j] = k[(rows + j) * lines + i] = n->c[i * cols + j];
    }
    for (int j = 0; j < cols; j++) {
        double *restrict row = root + (rows + j) * lines;
        for (int i = 0; i < rows; i++)
            for (int l = i; l < rows; l++)
                row[l] += n->scaled[i * cols + j] * n->root[i * rows + l];
        row[rows + j] = 1.0 / sqrt(n->col_sum[j]);
        for (int l = 0; l < cols; l++)
            k[(rows + j) * lines + rows + l] = n->d[j * cols + l];
    }
}

/* rho_ij = A_ii + D_jj - 2 C_ij */
VECTORISED static void two_terminal(int rows, int cols, Network *restrict n, double *restrict rho)
{
    double d[LINES];

    for (int j = 0; j < cols; j++)
        d[j] = 1.0 / n->col_sum[j];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            d[j] += n->scaled[i * cols + j] * n->c[i * cols + j];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            rho[i * cols + j] = n->a[i * rows + i] + d[j] - 2.0 * n->c[i * cols + j];
}

/* sum_b t_ab^2 p_b of laplacian.hessian_product. */
VECTORISED static void hessian_product(int rows, int cols, const double *restrict k,
                                       const double *restrict p, double *restrict out)
{
    int lines = rows + cols;
    double weighted[LINES * LINES], sums[LINES] = {0.0}, own[LINES] = {0.0};

    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            sums[i] += p[i * cols + j];
            sums[rows + j] += p[i * cols + j];
        }
    /* (P - D) K with P the picture between its lines: - L(p) K */
    for (int i = 0; i < lines; i++)
        for (int l = 0; l < lines; l++)
            weighted[i * lines + l] = -sums[i] * k[i * lines + l];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            double value = p[i * cols + j];
            if (value == 0.0)
                continue;
            double *restrict row = weighted + i * lines;
            double *restrict col = weighted + (rows + j) * lines;
            const double *restrict k_row = k + i * lines, *restrict k_col = k + (rows + j) * lines;
            for (int l = 0; l < lines; l++)
                row[l] += value * k_col[l];
            for (int l = 0; l < lines; l++)
                col[l] += value * k_row[l];
        }
    /* of K times that, the diagonal and what lies between rows and columns */
    for (int m = 0; m < lines; m++)
        for (int l = 0; l < lines; l++)
            own[l] += k[m * lines + l] * weighted[m * lines + l];
    for (int i = 0; i < rows; i++) {
        double *restrict row = out + i * cols;
        for (int j = 0; j < cols; j++)
            row[j] = 0.0;
        for (int m = 0; m < lines; m++)
            for (int j = 0; j < cols; j++)
                row[j] += k[i * lines + m] * weighted[m * lines + rows + j];
        for (int j = 0; j < cols; j++)
            row[j] = 2.0 * row[j] - own[i] - own[rows + j];
    }
}

/* weight_a across_ab^2 of laplacian.sensitivity, (told, n), in single precision. */
VECTORISED static void sensitivity(int rows, int cols, const double *restrict k,
                                   const double *restrict weight, const int *restrict told,
                                   Py_ssize_t n_told, const int *restrict one,
                                   const int *restrict other, Py_ssize_t n, float *restrict out)
{
    int lines = rows + cols;
    double voltage[LINES];

    for (Py_ssize_t a = 0; a < n_told; a++) {
        const double *restrict row = k + told[a] / cols * lines;
        const double *restrict col = k + (rows + told[a] % cols) * lines;
        for (int l = 0; l < lines; l++)
            voltage[l] = row[l] - col[l];
        double w = weight[told[a]];
        for (Py_ssize_t b = 0; b < n; b++) {
            double across = voltage[one[b]] - voltage[other[b]];
            out[a * n + b] = (float)(w * across * across);
        }
    }
}

/* --- the fixed point --------------------------------------------------------------------------- */

enum { HISTORY = 6 }; /* fixed_point._HISTORY */

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

/* fixed_point.iterate over the n cells `at`: g becomes the last point. Returns the steps taken, -1
 * if the network is singular to rounding. Vectors of n: x, then what is kept of the steps. */
VECTORISED static int iterate(int rows, int cols, double *restrict g, const int *restrict at,
                              Py_ssize_t n, const double *restrict measured,
                              const double *restrict low, const double *restrict high,
                              double r_ref, double r_par, double goal, int steps,
                              double *restrict space, Network *restrict network)
{
    double *restrict x = space, *restrict misfit = space + n, *restrict last = space + 2 * n;
    double *restrict d_misfit = space + 3 * n, *restrict d_image = d_misfit + HISTORY * n;
    double rho[CELLS];

    for (Py_ssize_t i = 0; i < n; i++)
        x[i] = log(g[at[i]]);
    for (int step = 0; step < steps; step++) {
        if (reduced_root(g, rows, cols, network) < 0)
            return -1;
        blocks(rows, cols, network);
        two_terminal(rows, cols, network, rho);
        double error = 0.0;
        for (Py_ssize_t i = 0; i < n; i++) {
            double off = r_ref / (r_ref + r_par + rho[at[i]]) - r_ref / (r_ref + r_par + measured[i]);
            error += off * off;
        }
        if (error <= goal)
            return step;
        int slot = (step + HISTORY - 1) % HISTORY, used = step < HISTORY ? step : HISTORY;
        for (Py_ssize_t i = 0; i < n; i++) {
            misfit[i] = log(rho[at[i]] / measured[i]);
            /* after d_image stands the last image, which is x + misfit */
            d_misfit[slot * n + i] = misfit[i] - last[i];
            d_image[slot * n + i] = x[i] + misfit[i] - d_image[HISTORY * n + i];
            d_image[HISTORY * n + i] = x[i] + misfit[i];
            last[i] = misfit[i];
        }
        double gram[HISTORY * HISTORY], share[HISTORY], trace = 0.0;
        for (int a = 0; a < used; a++) {
            for (int b = 0; b <= a; b++) {
                double sum = 0.0;
                for (Py_ssize_t i = 0; i < n; i++)
                    sum += d_misfit[a * n + i] * d_misfit[b * n + i];
                gram[a * HISTORY + b] = gram[b * HISTORY + a] = sum;
            }
            trace += gram[a * HISTORY + a];
            share[a] = 0.0;
            for (Py_ssize_t i = 0; i < n; i++)
                share[a] += d_misfit[a * n + i] * misfit[i];
        }
        for (int a = 0; a < used; a++)
            gram[a * HISTORY + a] += 1e-10 * trace + 1e-30;
        solve_small(gram, share, used);
        for (Py_ssize_t i = 0; i < n; i++) {
            double new = x[i] + misfit[i];
            for (int a = 0; a < used; a++)
                new -= share[a] * d_image[a * n + i];
            x[i] = fmin(fmax(new, low[i]), high[i]);
            g[at[i]] = exp(x[i]);
        }
    }
    return steps;
}

/* --- a step in a box --------------------------------------------------------------------------- */

enum { BLOCK = 4 }; /* rows taken at once: fewer ways to memory */

/* The diagonal of (U^T U)^-1: the squared length of each row of U^-1. */
VECTORISED static void inverse_diagonal(const float *restrict u, Py_ssize_t n,
                                        float *restrict row, double *restrict diagonal)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (Py_ssize_t k = i; k < n; k++)
            row[k] = 0.0f;
        row[i] = 1.0f;
        for (Py_ssize_t j = i; j < n; j += BLOCK) {
            Py_ssize_t end = j + BLOCK < n ? j + BLOCK : n;
            float v[BLOCK] = {0.0f};
            for (Py_ssize_t l = j; l < end; l++) {
                v[l - j] = row[l] / u[l * n + l];
                sum += v[l - j] * v[l - j];
                for (Py_ssize_t k = l + 1; k < end; k++)
                    row[k] -= v[l - j] * u[l * n + k];
            }
            const float *restrict u0 = u + j * n;
            for (Py_ssize_t k = end; k < n; k++)
                row[k] -= v[0] * u0[k] + v[1] * u0[n + k] + v[2] * u0[2 * n + k]
                          + v[3] * u0[3 * n + k];
        }
        diagonal[i] = sum;
    }
}

/* S = U^T U, both (n, n) in the upper triangle of s; -1 if S is not positive definite. */
VECTORISED static int cholesky(float *restrict s, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i += BLOCK) {
        Py_ssize_t end = i + BLOCK < n ? i + BLOCK : n;
        for (Py_ssize_t l = i; l < end; l++) {
            float *restrict row = s + l * n;
            for (Py_ssize_t j = i; j < l; j++)
                for (Py_ssize_t k = l; k < n; k++)
                    row[k] -= s[j * n + l] * s[j * n + k];
            if (!(row[l] > 0.0f))
                return -1;
            float scale = 1.0f / sqrtf(row[l]);
            for (Py_ssize_t k = l; k < n; k++)
                row[k] *= scale;
        }
        const float *restrict r = s + i * n;
        for (Py_ssize_t j = end; j < n; j++) { /* only reached by whole blocks */
            float *restrict other = s + j * n;
            float a = r[j], b = r[n + j], c = r[2 * n + j], d = r[3 * n + j];
            for (Py_ssize_t k = j; k < n; k++)
                other[k] -= a * r[k] + b * r[n + k] + c * r[2 * n + k] + d * r[3 * n + k];
        }
    }
    return 0;
}

/* x <- (U^T U)^-1 x */
static void solve(const float *restrict u, Py_ssize_t n, double *restrict x)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        x[i] /= u[i * n + i];
        for (Py_ssize_t k = i + 1; k < n; k++)
            x[k] -= u[i * n + k] * x[i];
    }
    for (Py_ssize_t i = n - 1; i >= 0; i--) {
        double sum = x[i];
        for (Py_ssize_t k = i + 1; k < n; k++)
            sum -= u[i * n + k] * x[k];
        x[i] = sum / u[i * n + i];
    }
}

static inline float entry(const float *s, Py_ssize_t n, Py_ssize_t i, Py_ssize_t k)
{
    return i < k ? s[i * n + k] : s[k * n + i];
}

/* map._solve_in_box: minimise 1/2 dx S dx - b dx; what would leave [low, high] is put on its end.
 * `u` becomes the factor over those `inside`, (m, m). Returns m, -1 if there is no factor. */
static Py_ssize_t solve_in_box(const float *restrict s, Py_ssize_t n, const double *restrict b,
                               const double *restrict low, const double *restrict high, int rounds,
                               double *restrict dx, char *restrict inside, float *restrict u,
                               double *restrict pull, Py_ssize_t *restrict at)
{
    static const float ridges[] = {0.0f, 1e-3f, 1e-2f, 1e-1f, 1.0f};
    Py_ssize_t m = n;

    memset(inside, 1, n);
    for (Py_ssize_t i = 0; i < n; i++)
        dx[i] = 0.0;
    for (int round = 1;; round++) {
        m = 0;
        for (Py_ssize_t i = 0; i < n; i++)
            if (inside[i])
                at[m++] = i;
        int failed = -1;
        float stretch = 1.0f; /* of the diagonal, where S is not definite to single precision */
        for (size_t r = 0; failed && r < sizeof ridges / sizeof *ridges; r++) {
            stretch *= 1.0f + ridges[r];
            for (Py_ssize_t i = 0; i < m; i++) {
                for (Py_ssize_t k = i; k < m; k++)
                    u[i * m + k] = s[at[i] * n + at[k]];
                u[i * m + i] *= stretch;
            }
            failed = cholesky(u, m);
        }
        if (failed)
            return -1;
        for (Py_ssize_t i = 0; i < m; i++) {
            pull[i] = b[at[i]];
            for (Py_ssize_t k = 0; m < n && k < n; k++)
                if (!inside[k])
                    pull[i] -= entry(s, n, at[i], k) * dx[k];
        }
        solve(u, m, pull);
        Py_ssize_t out = 0;
        for (Py_ssize_t i = 0; i < m; i++) {
            dx[at[i]] = pull[i];
            out += pull[i] < low[at[i]] || pull[i] > high[at[i]];
        }
        int done = round == rounds || !out || out == m;
        for (Py_ssize_t i = 0; i < n; i++) {
            if (!done && (dx[i] < low[i] || dx[i] > high[i]))
                inside[i] = 0;
            dx[i] = fmin(fmax(dx[i], low[i]), high[i]);
        }
        if (done)
            return m;
    }
}

/* --- the prior -------------------------------------------------------------------------------- */

enum { CHUNK = 8 }; /* factors multiplied before a logarithm is taken of them: none is extreme */

typedef struct {
    double product, sum;
    int count;
} LogSum;

static inline void log_add(LogSum *logs, double factor)
{
    logs->product *= factor;
    if (++logs->count == CHUNK) {
        logs->sum += log(logs->product);
        logs->product = 1.0;
        logs->count = 0;
    }
}

/* prior.touches: the cost of weight/2 log(square + d^2) of each difference d of the cells' x, and of
 * weight log(1 + height/spread) of each cell; its gradient, and its majorant's precision.
 *
 * ends: each difference's 2 or 4 cells, with the signs - + and + - - +; joins: where the pairs of
 * them, (01), or (01) (02) (03) (12) (13) (23), lie in `entries`. */
static double touches(const double *restrict x, Py_ssize_t cells, double x_rest,
                      const int *restrict ends2, const int *restrict joins2, Py_ssize_t n2,
                      const int *restrict ends4, const int *restrict joins4, Py_ssize_t n4,
                      const double *restrict spreads, double *restrict gradient,
                      double *restrict diagonal, double *restrict entries, Py_ssize_t n_entries)
{
    double weight = spreads[0], square = spreads[1] * spreads[1], value = 0.0;
    LogSum logs = {1.0, 0.0, 0};

    for (Py_ssize_t i = 0; i < cells; i++)
        gradient[i] = diagonal[i] = 0.0;
    for (Py_ssize_t e = 0; e < n_entries; e++)
        entries[e] = 0.0;
    for (Py_ssize_t e = 0; e < n2; e++) {
        int i = ends2[2 * e], j = ends2[2 * e + 1];
        double d = x[j] - x[i], s = square + d * d, w = weight / s;
        log_add(&logs, s);
        gradient[i] -= w * d;
        gradient[j] += w * d;
        diagonal[i] += w;
        diagonal[j] += w;
        entries[joins2[e]] -= w;
    }
    value += 0.5 * weight * (logs.sum + log(logs.product));
    weight = spreads[2], square = spreads[3] * spreads[3];
    logs = (LogSum){1.0, 0.0, 0};
    for (Py_ssize_t e = 0; e < n4; e++) {
        const int *c = ends4 + 4 * e, *at = joins4 + 6 * e;
        double d = x[c[0]] - x[c[1]] - x[c[2]] + x[c[3]], s = square + d * d, w = weight / s;
        log_add(&logs, s);
        gradient[c[0]] += w * d;
        gradient[c[1]] -= w * d;
        gradient[c[2]] -= w * d;
        gradient[c[3]] += w * d;
        for (int i = 0; i < 4; i++)
            diagonal[c[i]] += w;
        entries[at[0]] -= w;
        entries[at[1]] -= w;
        entries[at[2]] += w;
        entries[at[3]] += w;
        entries[at[4]] -= w;
        entries[at[5]] -= w;
    }
    value += 0.5 * weight * (logs.sum + log(logs.product));
    weight = spreads[4];
    logs = (LogSum){1.0, 0.0, 0};
    for (Py_ssize_t i = 0; i < cells; i++) {
        double above = (x[i] - (x_rest - spreads[5])) / spreads[5];
        log_add(&logs, above);
        gradient[i] += weight / spreads[5] / above;
    }
    return value + weight * (logs.sum + log(logs.product));
}

/* --- Python ----------------------------------------------------------------------------------- */

/* Views on the arguments, all or none. */
typedef struct {
    Py_buffer of[12];
    int count;
} Views;

static void release(Views *views)
{
    while (views->count)
        PyBuffer_Release(&views->of[--views->count]);
}

/* The data of an array of `n` numbers of one kind ('d', 'f', 'i', '?'); NULL and an exception if it is not. */
static void *take(Views *views, PyObject *array, char kind, Py_ssize_t n, int writable)
{
    Py_buffer *view = &views->of[views->count];
    int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);

    if (PyObject_GetBuffer(array, view, flags) < 0)
        return NULL;
    views->count++;
    if (view->format == NULL || view->format[0] != kind || view->format[1] != '\0'
        || view->len != n * view->itemsize) {
        PyErr_Format(PyExc_ValueError, "kernel: an array of %zd '%c' is due, got %zd bytes of '%s'",
                     n, kind, view->len, view->format ? view->format : "?");
        return NULL;
    }
    return view->buf;
}

/* The number of items of an array, from its buffer. */
static Py_ssize_t size_of(PyObject *array)
{
    Py_buffer view;

    if (PyObject_GetBuffer(array, &view, PyBUF_C_CONTIGUOUS) < 0)
        return -1;
    Py_ssize_t n = view.len / view.itemsize;
    PyBuffer_Release(&view);
    return n;
}

/* A skin's size from its first two arguments; 0 and an exception if it has too many lines. */
static int size(PyObject *const *args, Py_ssize_t count, Py_ssize_t due, int *rows, int *cols)
{
    if (count != due) {
        PyErr_Format(PyExc_TypeError, "kernel: %zd arguments are due, got %zd", due, count);
        return 0;
    }
    long r = PyLong_AsLong(args[0]), c = PyLong_AsLong(args[1]);
    if (PyErr_Occurred())
        return 0;
    if (r < 1 || c < 1 || r + c > LINES) {
        PyErr_Format(PyExc_ValueError, "kernel: %ld x %ld: at most %d lines", r, c, LINES);
        return 0;
    }
    *rows = (int)r;
    *cols = (int)c;
    return 1;
}

static PyObject *py_two_terminal(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    Network n;
    PyObject *done = NULL;
    int rows, cols;
    double *g, *rho;

    if (!size(args, count, 4, &rows, &cols))
        return NULL;
    if ((g = take(&views, args[2], 'd', rows * cols, 0))
        && (rho = take(&views, args[3], 'd', rows * cols, 1))) {
        int singular = reduced_root(g, rows, cols, &n);
        if (!singular) {
            blocks(rows, cols, &n);
            two_terminal(rows, cols, &n, rho);
        }
        done = PyBool_FromLong(!singular);
    }
    release(&views);
    return done;
}

static PyObject *py_network(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    Network n;
    PyObject *done = NULL;
    int rows, cols;
    double *g, *root, *k, *rho;

    if (!size(args, count, 6, &rows, &cols))
        return NULL;
    Py_ssize_t lines = rows + cols;
    if ((g = take(&views, args[2], 'd', rows * cols, 0))
        && (root = take(&views, args[3], 'd', lines * lines, 1))
        && (k = take(&views, args[4], 'd', lines * lines, 1))
        && (rho = take(&views, args[5], 'd', rows * cols, 1))) {
        int singular = reduced_root(g, rows, cols, &n);
        if (!singular) {
            blocks(rows, cols, &n);
            whole(rows, cols, &n, root, k);
            two_terminal(rows, cols, &n, rho);
        }
        done = PyBool_FromLong(!singular);
    }
    release(&views);
    return done;
}

static PyObject *py_hessian_product(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *done = NULL;
    int rows, cols;
    double *k, *p, *out;

    if (!size(args, count, 5, &rows, &cols))
        return NULL;
    Py_ssize_t lines = rows + cols;
    if ((k = take(&views, args[2], 'd', lines * lines, 0))
        && (p = take(&views, args[3], 'd', rows * cols, 0))
        && (out = take(&views, args[4], 'd', rows * cols, 1))) {
        hessian_product(rows, cols, k, p, out);
        done = Py_NewRef(Py_None);
    }
    release(&views);
    return done;
}

static PyObject *py_sensitivity(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *done = NULL;
    int rows, cols, *told, *one, *other;
    double *k, *weight;
    float *out;

    if (!size(args, count, 8, &rows, &cols))
        return NULL;
    Py_ssize_t lines = rows + cols, n_told = size_of(args[4]), n = size_of(args[5]);
    if (PyErr_Occurred())
        return NULL;
    if ((k = take(&views, args[2], 'd', lines * lines, 0))
        && (weight = take(&views, args[3], 'd', rows * cols, 0))
        && (told = take(&views, args[4], 'i', n_told, 0)) && (one = take(&views, args[5], 'i', n, 0))
        && (other = take(&views, args[6], 'i', n, 0))
        && (out = take(&views, args[7], 'f', n_told * n, 1))) {
        sensitivity(rows, cols, k, weight, told, n_told, one, other, n, out);
        done = Py_NewRef(Py_None);
    }
    release(&views);
    return done;
}

static PyObject *py_solve_in_box(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *found = NULL;
    float *s, *u;
    double *b, *low, *high, *dx;
    char *inside;

    if (count != 8) {
        PyErr_Format(PyExc_TypeError, "kernel: 8 arguments are due, got %zd", count);
        return NULL;
    }
    Py_ssize_t n = size_of(args[1]);
    long rounds = PyLong_AsLong(args[4]);
    if (PyErr_Occurred())
        return NULL;
    double *pull = PyMem_Malloc((n + 1) * sizeof *pull);
    Py_ssize_t *at = PyMem_Malloc((n + 1) * sizeof *at);
    if (!pull || !at)
        PyErr_NoMemory();
    else if ((s = take(&views, args[0], 'f', n * n, 0)) && (b = take(&views, args[1], 'd', n, 0))
             && (low = take(&views, args[2], 'd', n, 0))
             && (high = take(&views, args[3], 'd', n, 0)) && (dx = take(&views, args[5], 'd', n, 1))
             && (inside = take(&views, args[6], '?', n, 1))
             && (u = take(&views, args[7], 'f', n * n, 1)))
        found = PyLong_FromSsize_t(
            solve_in_box(s, n, b, low, high, (int)rounds, dx, inside, u, pull, at));
    release(&views);
    PyMem_Free(pull);
    PyMem_Free(at);
    return found;
}

static PyObject *py_inverse_diagonal(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *done = NULL;
    float *u, *row;
    double *diagonal;

    if (count != 2) {
        PyErr_Format(PyExc_TypeError, "kernel: 2 arguments are due, got %zd", count);
        return NULL;
    }
    Py_ssize_t n = size_of(args[1]);
    if (n < 0)
        return NULL;
    if (!(row = PyMem_Malloc((n + 1) * sizeof *row)))
        PyErr_NoMemory();
    else if ((u = take(&views, args[0], 'f', n * n, 0))
             && (diagonal = take(&views, args[1], 'd', n, 1))) {
        inverse_diagonal(u, n, row, diagonal);
        done = Py_NewRef(Py_None);
    }
    release(&views);
    PyMem_Free(row);
    return done;
}

static PyObject *py_iterate(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    Network network;
    PyObject *steps = NULL;
    int rows, cols, *at;
    double *g, *measured, *low, *high;

    if (!size(args, count, 11, &rows, &cols))
        return NULL;
    double r_ref = PyFloat_AsDouble(args[7]), r_par = PyFloat_AsDouble(args[8]);
    double goal = PyFloat_AsDouble(args[9]);
    long most = PyLong_AsLong(args[10]);
    Py_ssize_t n = size_of(args[3]);
    if (PyErr_Occurred())
        return NULL;
    double *space = PyMem_Calloc((2 * HISTORY + 4) * n + 1, sizeof *space);
    if (!space)
        PyErr_NoMemory();
    else if ((g = take(&views, args[2], 'd', rows * cols, 1)) && (at = take(&views, args[3], 'i', n, 0))
             && (measured = take(&views, args[4], 'd', n, 0))
             && (low = take(&views, args[5], 'd', n, 0)) && (high = take(&views, args[6], 'd', n, 0)))
        steps = PyLong_FromLong(iterate(rows, cols, g, at, n, measured, low, high, r_ref, r_par,
                                        goal, (int)most, space, &network));
    release(&views);
    PyMem_Free(space);
    return steps;
}

/* Add the prior's precision to that over the n unknowns, (n, n) upper. */
static PyObject *py_join(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *done = NULL;
    float *precision;
    double *entries;
    int *place, *here, *there;

    if (count != 6) {
        PyErr_Format(PyExc_TypeError, "kernel: 6 arguments are due, got %zd", count);
        return NULL;
    }
    Py_ssize_t n = PyLong_AsSsize_t(args[1]), n_entries = size_of(args[3]);
    Py_ssize_t cells = size_of(args[2]);
    if (PyErr_Occurred())
        return NULL;
    if ((precision = take(&views, args[0], 'f', n * n, 1))
        && (place = take(&views, args[2], 'i', cells, 0))
        && (entries = take(&views, args[3], 'd', n_entries, 0))
        && (here = take(&views, args[4], 'i', n_entries, 0))
        && (there = take(&views, args[5], 'i', n_entries, 0))) {
        for (Py_ssize_t e = 0; e < n_entries; e++) {
            int i = place[here[e]], k = place[there[e]];
            if (i >= 0 && k >= 0)
                precision[i * n + k] += (float)entries[e];
        }
        done = Py_NewRef(Py_None);
    }
    release(&views);
    return done;
}

static PyObject *py_touches(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Views views = {.count = 0};
    PyObject *value = NULL;
    double *x, *spreads, *gradient, *diagonal, *entries;
    int *ends2, *joins2, *ends4, *joins4;

    if (count != 10) {
        PyErr_Format(PyExc_TypeError, "kernel: 10 arguments are due, got %zd", count);
        return NULL;
    }
    double x_rest = PyFloat_AsDouble(args[1]);
    Py_ssize_t cells = size_of(args[0]), n2 = size_of(args[3]), n4 = size_of(args[4]) / 4;
    Py_ssize_t n_entries = size_of(args[9]);
    if (PyErr_Occurred())
        return NULL;
    if ((x = take(&views, args[0], 'd', cells, 0)) && (ends2 = take(&views, args[2], 'i', 2 * n2, 0))
        && (joins2 = take(&views, args[3], 'i', n2, 0))
        && (ends4 = take(&views, args[4], 'i', 4 * n4, 0))
        && (joins4 = take(&views, args[5], 'i', 6 * n4, 0))
        && (spreads = take(&views, args[6], 'd', 6, 0))
        && (gradient = take(&views, args[7], 'd', cells, 1))
        && (diagonal = take(&views, args[8], 'd', cells, 1))
        && (entries = take(&views, args[9], 'd', n_entries, 1)))
        value = PyFloat_FromDouble(touches(x, cells, x_rest, ends2, joins2, n2, ends4, joins4, n4,
                                           spreads, gradient, diagonal, entries, n_entries));
    release(&views);
    return value;
}

#define FAST(name, text) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    FAST(two_terminal, "(rows, cols, g, rho) -> whether S was positive definite; fills rho"),
    FAST(network, "(rows, cols, g, root, k, rho) -> the same; fills laplacian.Network"),
    FAST(hessian_product, "(rows, cols, k, p, out); fills out"),
    FAST(sensitivity, "(rows, cols, k, weight, told, one, other, out); fills out (told, one)"),
    FAST(solve_in_box, "(s, b, low, high, rounds, dx, inside, u) -> m, or -1; fills the last three"),
    FAST(join, "(precision, n, place, entries, here, there); adds to precision"),
    FAST(inverse_diagonal, "(u, diagonal); fills diagonal"),
    FAST(iterate, "(rows, cols, g, at, measured, low, high, r_ref, r_par, goal, steps) -> steps taken, "
                  "or -1; changes g"),
    FAST(touches, "(x, x_rest, ends2, joins2, ends4, joins4, spreads, gradient, diagonal, entries) "
                  "-> value; fills the last three"),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernel", "The inner loops, compiled.", 0, methods,
};

PyMODINIT_FUNC PyInit__kernel(void)
{
    PyObject *module = PyModule_Create(&definition);

    if (module && PyModule_AddIntConstant(module, "LINES", LINES) < 0)
        Py_CLEAR(module);
    return module;
}
