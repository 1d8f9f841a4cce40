/* What runs in every step of every iteration, for one frame.
 *
 * ../kernel.py says what each function is and chooses between these and the same in NumPy, which
 * serves skins of more than LINES stripes. NumPy's cost at this size is its calls, not its
 * arithmetic: that is all there is to win here.
 *
 * Pictures are (rows, cols), matrices row by row, lines = rows + cols; all memory is the caller's.
 * Inner loops add multiples of rows to rows, which compilers vectorise without being allowed to
 * reorder sums. A loop that calls the mathematical library does nothing else: GCC makes slow code of
 * one that it vectorises around such a call.
 */
#ifndef TACTILE_SKIN_KERNEL_H
#define TACTILE_SKIN_KERNEL_H

#include <limits.h> /* defines __GLIBC__ where it is the C library */
#include <stddef.h>

#define LINES 64
#define CELLS (LINES * LINES / 4)

/* AVX2 where the processor has it: the package is built for any. The loader chooses. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORISED __attribute__((target_clones("avx2,fma", "default")))
#else
#define VECTORISED
#endif

typedef struct {
    double scaled[CELLS];         /* (rows, cols) g D_c^-1 */
    double col_sum[LINES];        /* D_c */
    double root[LINES * LINES];   /* (rows, rows) upper R with A = R R^T */
    double turned[LINES * LINES]; /* its transpose */
    double a[LINES * LINES];      /* (rows, rows), (rows, cols): blocks of K */
    double c[CELLS];
} Network;

/* Fills the network of conductances g; -1 if it is singular to rounding, or holds NaN. */
int network_of(const double *g, int rows, int cols, Network *n);
void two_terminal(int rows, int cols, const Network *n, double *rho);
void whole(int rows, int cols, const Network *n, double *root, double *k);
void sensitivity(int rows, int cols, const double *k, const double *weight, const int *told,
                 ptrdiff_t n_told, const int *one, const int *other, ptrdiff_t n, float *out);
void hessian_product(int rows, int cols, const double *k, const double *p, double *out);
double roughness(int rows, int cols, const double *x, const double *weight, double square,
             double *gradient, double *diagonal, double *entries);

void interpolate(const double *x, ptrdiff_t n, const double *points, const double *values,
                 ptrdiff_t n_points, const int *start, ptrdiff_t n_start, double *out);

ptrdiff_t convolve_space(int channels, int rows, int cols, int dilation); /* floats */
void convolve(int channels, int rows, int cols, int n_out, int dilation, const float *picture,
              const float *layer, float *out, float *space);

ptrdiff_t solve_in_box(ptrdiff_t n, const float *precision, const double *b, const double *low,
                       const double *high, double *dx, float *factor, int *inside, float *space,
                       int *kept);

enum { HISTORY = 6, ITERATE_SPACE = 2 * HISTORY + 6 }; /* vectors of n that iterate needs */

int iterate(int rows, int cols, double *g, const int *at, ptrdiff_t n, const double *measured,
            const double *low, const double *high, double r_ref, double r_par, double goal,
            int steps, double seconds, double *space, Network *network);

#endif
