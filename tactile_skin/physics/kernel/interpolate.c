/* A table between its points, as np.interp. */
#include "kernel.h"

/* kernel.Table: `start` holds the last point at or below the begin of each of n_start equal parts of
 * the table's length, from where the search is short. */
VECTORISED void interpolate(const double *restrict x, ptrdiff_t n, const double *restrict points,
                            const double *restrict values, ptrdiff_t n_points,
                            const int *restrict start, ptrdiff_t n_start, double *restrict out)
{
    double first = points[0], last = points[n_points - 1], parts = n_start / (last - first);

    for (ptrdiff_t i = 0; i < n; i++) {
        if (!(x[i] > first && x[i] < last)) {
            out[i] = x[i] <= first ? values[0] : x[i] >= last ? values[n_points - 1] : x[i];
            continue;
        }
        ptrdiff_t part = (ptrdiff_t)((x[i] - first) * parts);
        ptrdiff_t at = start[part < n_start ? part : n_start - 1];
        if (at < 0 || at > n_points - 2) /* whatever `start` holds */
            at = 0;
        while (points[at + 1] <= x[i])
            at++;
        out[i] = values[at]
                 + (values[at + 1] - values[at]) / (points[at + 1] - points[at]) * (x[i] - points[at]);
    }
}
