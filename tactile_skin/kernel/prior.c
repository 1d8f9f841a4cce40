/* solvers/prior.py's cost of touches. */
#include "kernel.h"

#include <math.h>

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
double touches(const double *restrict x, ptrdiff_t cells, double x_rest,
                      const int *restrict ends2, const int *restrict joins2, ptrdiff_t n2,
                      const int *restrict ends4, const int *restrict joins4, ptrdiff_t n4,
                      const double *restrict spreads, double *restrict gradient,
                      double *restrict diagonal, double *restrict entries, ptrdiff_t n_entries)
{
    double weight = spreads[0], square = spreads[1] * spreads[1], value = 0.0;
    LogSum logs = {1.0, 0.0, 0};

    for (ptrdiff_t i = 0; i < cells; i++)
        gradient[i] = diagonal[i] = 0.0;
    for (ptrdiff_t e = 0; e < n_entries; e++)
        entries[e] = 0.0;
    for (ptrdiff_t e = 0; e < n2; e++) {
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
    for (ptrdiff_t e = 0; e < n4; e++) {
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
    for (ptrdiff_t i = 0; i < cells; i++) {
        double above = (x[i] - (x_rest - spreads[5])) / spreads[5];
        log_add(&logs, above);
        gradient[i] += weight / spreads[5] / above;
    }
    return value + weight * (logs.sum + log(logs.product));
}
