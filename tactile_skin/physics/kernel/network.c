/* The network of one frame: numpy_kernel.py holds the same in NumPy. */
#include "kernel.h"

#include <math.h>

typedef double Four __attribute__((vector_size(4 * sizeof(double)), aligned(sizeof(double))));

/* out[k] += the sum over m rows of factors[j] rows[j][k], n of each. The sums stay in registers. */
static inline void combine(double *restrict out, int n, const double *restrict factors,
                           const double *restrict rows, int stride, int m)
{
    int k = 0;

    for (; k + 16 <= n; k += 16) {
        Four *to = (Four *)(out + k), a = to[0], b = to[1], c = to[2], d = to[3];
        for (int j = 0; j < m; j++) {
            const Four *from = (const Four *)(rows + j * stride + k);
            a += factors[j] * from[0];
            b += factors[j] * from[1];
            c += factors[j] * from[2];
            d += factors[j] * from[3];
        }
        to[0] = a, to[1] = b, to[2] = c, to[3] = d;
    }
    for (; k < n; k++)
        for (int j = 0; j < m; j++)
            out[k] += factors[j] * rows[j * stride + k];
}

/* R of numpy_kernel.reduced_root; -1 if S is singular to rounding, or holds NaN. */
VECTORISED static int reduced_root(const double *restrict g, int rows, int cols,
                                   Network *restrict n)
{
    double turned_g[CELLS], row_sum[LINES], s[LINES * LINES], factors[LINES];
    double total = 0.0;

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
            n->scaled[i * cols + j] = g[i * cols + j] / n->col_sum[j];
            factors[j] = -n->scaled[i * cols + j];
        }
        combine(row, rows, factors, turned_g, rows, cols);
    }
    /* S = U^T U and (U^T) R^T = 1, row by row: U in the upper triangle of s, R^T in turned */
    for (int i = 0; i < rows; i++) {
        double *restrict row = s + i * rows, *restrict turned = n->turned + i * rows;
        for (int k = 0; k < rows; k++)
            turned[k] = k == i;
        for (int j = 0; j < i; j++)
            factors[j] = -s[j * rows + i];
        combine(row, rows, factors, s, rows, i);
        combine(turned, rows, factors, n->turned, rows, i);
        if (!(row[i] > 0.0))
            return -1;
        double scale = 1.0 / sqrt(row[i]);
        for (int k = 0; k < rows; k++) {
            row[k] *= scale;
            turned[k] *= scale;
        }
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
        combine(a, rows, n->root + i * rows + i, n->turned + i * rows, rows, rows - i);
        for (int k = 0; k < cols; k++)
            c[k] = 0.0;
        combine(c, cols, a, n->scaled, cols, rows);
    }
}

int network_of(const double *g, int rows, int cols, Network *n)
{
    if (reduced_root(g, rows, cols, n) < 0)
        return -1;
    blocks(rows, cols, n);
    return 0;
}

/* K, (lines, lines), and its root W, of numpy_kernel.Network. */
VECTORISED void whole(int rows, int cols, const Network *restrict n, double *restrict root,
                      double *restrict k)
{
    int lines = rows + cols;
    double shares[LINES]; /* a column of n->scaled */

    for (int i = 0; i < lines * lines; i++)
        root[i] = k[i] = 0.0;
    for (int i = 0; i < rows; i++) {
        for (int l = 0; l < rows; l++) {
            root[i * lines + l] = n->root[i * rows + l];
            k[i * lines + l] = n->a[i * rows + l];
        }
        for (int j = 0; j < cols; j++)
            k[i * lines + rows + j] = k[(rows + j) * lines + i] = n->c[i * cols + j];
    }
    for (int j = 0; j < cols; j++) {
        for (int i = 0; i < rows; i++)
            shares[i] = n->scaled[i * cols + j];
        combine(root + (rows + j) * lines, rows, shares, n->root, rows, rows);
        root[(rows + j) * (lines + 1)] = 1.0 / sqrt(n->col_sum[j]);
        combine(k + (rows + j) * lines + rows, cols, shares, n->c, cols, rows);
        k[(rows + j) * (lines + 1)] += 1.0 / n->col_sum[j];
    }
}

/* rho_ij = A_ii + D_jj - 2 C_ij */
VECTORISED void two_terminal(int rows, int cols, const Network *restrict n, double *restrict rho)
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

/* weight_a across_ab^2 of kernel.sensitivity, (told, n), in single precision. */
VECTORISED void sensitivity(int rows, int cols, const double *restrict k,
                            const double *restrict weight, const int *restrict told,
                            ptrdiff_t n_told, const int *restrict one, const int *restrict other,
                            ptrdiff_t n, float *restrict out)
{
    int lines = rows + cols;
    double voltage[LINES];

    for (ptrdiff_t a = 0; a < n_told; a++) {
        const double *restrict row = k + told[a] / cols * lines;
        const double *restrict col = k + (rows + told[a] % cols) * lines;
        for (int l = 0; l < lines; l++)
            voltage[l] = row[l] - col[l];
        double w = weight[told[a]];
        for (ptrdiff_t b = 0; b < n; b++) {
            double across = voltage[one[b]] - voltage[other[b]];
            out[a * n + b] = (float)(w * across * across);
        }
    }
}

/* sum_b t_ab^2 p_b, (rows, cols): it is K L(p) K between a's two lines. */
VECTORISED void hessian_product(int rows, int cols, const double *restrict k,
                                const double *restrict p, double *restrict out)
{
    int lines = rows + cols;
    double image[LINES * LINES], own[LINES]; /* L(p) K; the diagonal of K L(p) K */

    for (int i = 0; i < lines; i++)
        for (int l = 0; l < lines; l++)
            image[i * lines + l] = 0.0;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            double *restrict row = image + i * lines, *restrict col = image + (rows + j) * lines;
            const double *restrict one = k + i * lines, *restrict other = k + (rows + j) * lines;
            double factor = p[i * cols + j];
            if (factor == 0.0)
                continue;
            for (int l = 0; l < lines; l++) {
                double flow = factor * (one[l] - other[l]);
                row[l] += flow;
                col[l] -= flow;
            }
        }
    for (int i = 0; i < lines; i++) {
        own[i] = 0.0;
        for (int l = 0; l < lines; l++)
            own[i] += k[i * lines + l] * image[l * lines + i];
    }
    for (int i = 0; i < rows; i++) {
        double *restrict row = out + i * cols;
        for (int j = 0; j < cols; j++)
            row[j] = 0.0;
        for (int l = 0; l < lines; l++)
            for (int j = 0; j < cols; j++)
                row[j] += k[i * lines + l] * image[l * lines + rows + j];
        for (int j = 0; j < cols; j++)
            row[j] = own[i] + own[rows + j] - 2.0 * row[j];
    }
}
