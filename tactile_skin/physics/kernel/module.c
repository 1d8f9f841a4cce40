/* The Python module tactile_skin.physics._kernel. Whatever Python passes, no memory but that of its
 * arrays is touched: their types, sizes and indices are checked. Work that may take more than 50 us
 * gives up the GIL; less does not, since another thread would hold it for 5 ms. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "kernel.h"

/* Arguments; steps of an iteration; channels, rows, columns and dilation of a convolution */
enum { MOST = 12, MOST_STEPS = 1000000, MOST_SIZE = 4096 };

/* The arguments of one call, in order: n an integer, x a number; arrays of d double, f float, i int,
 * in capitals if they are filled. */
typedef struct {
    Py_buffer views[MOST];
    void *data[MOST];      /* of arrays */
    Py_ssize_t size[MOST]; /* of arrays: their number of items; of integers: the value */
    double x[MOST];
    int open; /* views */
    PyObject *result;
} Call;

static int take(Call *call, int k, PyObject *array, char kind)
{
    static const struct {
        char kind, format;
    } formats[] = {{'d', 'd'}, {'f', 'f'}, {'i', 'i'}};
    int writable = Py_ISUPPER(kind), flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT;
    Py_buffer *view = &call->views[call->open];

    if (PyObject_GetBuffer(array, view, writable ? flags | PyBUF_WRITABLE : flags) < 0)
        return 0;
    call->open++;
    for (size_t f = 0; f < sizeof formats / sizeof *formats; f++)
        if (formats[f].kind == Py_TOLOWER(kind) && view->format[0] == formats[f].format
            && view->format[1] == '\0') {
            call->data[k] = view->buf;
            call->size[k] = view->len / view->itemsize;
            return 1;
        }
    PyErr_Format(PyExc_ValueError, "kernel: argument %d: must be an array of '%c', is of '%s'", k,
                 Py_TOLOWER(kind), view->format);
    return 0;
}

static int begin(Call *call, PyObject *const *args, Py_ssize_t count, const char *kinds)
{
    call->open = 0;
    call->result = NULL;
    if (count != (Py_ssize_t)strlen(kinds)) {
        PyErr_Format(PyExc_TypeError, "kernel: %zd arguments are due, got %zd", strlen(kinds), count);
        return 0;
    }
    for (int k = 0; k < count; k++) {
        if (kinds[k] == 'n')
            call->size[k] = PyLong_AsSsize_t(args[k]);
        else if (kinds[k] == 'x')
            call->x[k] = PyFloat_AsDouble(args[k]);
        else if (!take(call, k, args[k], kinds[k]))
            return 0;
        if ((kinds[k] == 'n' || kinds[k] == 'x') && PyErr_Occurred())
            return 0;
    }
    return 1;
}

static int sized(Call *call, int k, Py_ssize_t due)
{
    if (call->size[k] == due)
        return 1;
    PyErr_Format(PyExc_ValueError, "kernel: argument %d: must have %zd items, has %zd", k, due,
                 call->size[k]);
    return 0;
}

/* Whether the first two arguments are the size of a skin that is small enough. */
static int skin(Call *call)
{
    Py_ssize_t rows = call->size[0], cols = call->size[1];

    if (0 < rows && rows < LINES && 0 < cols && cols <= LINES - rows)
        return 1;
    PyErr_Format(PyExc_ValueError, "kernel: %zd x %zd: must be 1 to %d lines in all", call->size[0],
                 call->size[1], LINES);
    return 0;
}

/* Whether the integers of an array lie in [0, end). */
static int within(Call *call, int k, int end)
{
    const int *values = call->data[k];

    for (Py_ssize_t i = 0; i < call->size[k]; i++)
        if (values[i] < 0 || values[i] >= end) {
            PyErr_Format(PyExc_ValueError, "kernel: argument %d: %d at %zd: must be from 0 to %d", k,
                         values[i], i, end - 1);
            return 0;
        }
    return 1;
}

/* The GIL, given up if this many multiplications may take more than 50 us; of a network there are
 * about lines^3, which at 32 lines take 20 us. */
static PyThreadState *release(double multiplications)
{
    return multiplications > 50000.0 ? PyEval_SaveThread() : NULL;
}

static void acquire(PyThreadState *released)
{
    if (released)
        PyEval_RestoreThread(released);
}

static PyObject *end(Call *call)
{
    while (call->open)
        PyBuffer_Release(&call->views[--call->open]);
    return call->result;
}

#define ROWS ((int)call.size[0])
#define COLS ((int)call.size[1])
#define CUBED ((double)(ROWS + COLS) * (ROWS + COLS) * (ROWS + COLS))

static PyObject *py_two_terminal(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network n;

    if (begin(&call, args, count, "nndD") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 3, ROWS * COLS)) {
        PyThreadState *released = release(0.4 * CUBED);
        int regular = network_of(call.data[2], ROWS, COLS, &n) == 0;
        if (regular)
            two_terminal(ROWS, COLS, &n, call.data[3]);
        acquire(released);
        call.result = PyBool_FromLong(regular);
    }
    return end(&call);
}

static PyObject *py_network(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network n;

    if (begin(&call, args, count, "nndDDD") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 3, (ROWS + COLS) * (ROWS + COLS))
        && sized(&call, 4, (ROWS + COLS) * (ROWS + COLS)) && sized(&call, 5, ROWS * COLS)) {
        PyThreadState *released = release(CUBED);
        int regular = network_of(call.data[2], ROWS, COLS, &n) == 0;
        if (regular) {
            whole(ROWS, COLS, &n, call.data[3], call.data[4]);
            two_terminal(ROWS, COLS, &n, call.data[5]);
        }
        acquire(released);
        call.result = PyBool_FromLong(regular);
    }
    return end(&call);
}

static PyObject *py_sensitivity(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnddiiiF") && skin(&call)
        && sized(&call, 2, (ROWS + COLS) * (ROWS + COLS)) && sized(&call, 3, ROWS * COLS)
        && sized(&call, 6, call.size[5]) && sized(&call, 7, call.size[4] * call.size[5])
        && within(&call, 4, ROWS * COLS) && within(&call, 5, ROWS + COLS)
        && within(&call, 6, ROWS + COLS)) {
        PyThreadState *released = release((double)call.size[7]);
        sensitivity(ROWS, COLS, call.data[2], call.data[3], call.data[4], call.size[4],
                    call.data[5], call.data[6], call.size[5], call.data[7]);
        acquire(released);
        call.result = Py_NewRef(Py_None);
    }
    return end(&call);
}

static PyObject *py_hessian_product(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnddD") && skin(&call)
        && sized(&call, 2, (ROWS + COLS) * (ROWS + COLS)) && sized(&call, 3, ROWS * COLS)
        && sized(&call, 4, ROWS * COLS)) {
        PyThreadState *released = release(0.75 * CUBED);
        hessian_product(ROWS, COLS, call.data[2], call.data[3], call.data[4]);
        acquire(released);
        call.result = Py_NewRef(Py_None);
    }
    return end(&call);
}

static PyObject *py_roughness(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnddxDDD") && skin(&call)) {
        Py_ssize_t differences = ROWS * (COLS - 1) + (ROWS - 1) * COLS;
        if (sized(&call, 2, ROWS * COLS) && sized(&call, 3, differences)
            && sized(&call, 5, ROWS * COLS) && sized(&call, 6, ROWS * COLS)
            && sized(&call, 7, differences))
            call.result = PyFloat_FromDouble(roughness(ROWS, COLS, call.data[2], call.data[3],
                                                   call.x[4], call.data[5], call.data[6],
                                                   call.data[7]));
    }
    return end(&call);
}

static PyObject *py_solve_in_box(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "fdddDFI")) {
        Py_ssize_t n = call.size[1];
        float *space = NULL;
        int *kept = NULL;
        if (sized(&call, 0, n * n) && sized(&call, 2, n) && sized(&call, 3, n)
            && sized(&call, 4, n) && sized(&call, 5, n * n) && sized(&call, 6, n)) {
            space = PyMem_Calloc(n + 1, sizeof *space);
            kept = PyMem_Calloc(2 * n + 1, sizeof *kept);
            if (space && kept) {
                PyThreadState *released = release((double)n * n * n / 3.0);
                Py_ssize_t m = solve_in_box(n, call.data[0], call.data[1], call.data[2],
                                            call.data[3], call.data[4], call.data[5],
                                            call.data[6], space, kept);
                acquire(released);
                call.result = PyLong_FromSsize_t(m);
            } else
                PyErr_NoMemory();
        }
        PyMem_Free(space);
        PyMem_Free(kept);
    }
    return end(&call);
}

static PyObject *py_iterate(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network network;

    if (begin(&call, args, count, "nnDidddxxxnx") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 4, call.size[3]) && sized(&call, 5, call.size[3])
        && sized(&call, 6, call.size[3]) && within(&call, 3, ROWS * COLS)) {
        Py_ssize_t n = call.size[3];
        int steps = call.size[10] < MOST_STEPS ? (int)call.size[10] : MOST_STEPS;
        double *space = PyMem_Calloc(ITERATE_SPACE * n + 1, sizeof *space);
        if (space) {
            PyThreadState *released = release(steps * (0.4 * CUBED + 50.0 * n));
            int taken = iterate(ROWS, COLS, call.data[2], call.data[3], n, call.data[4],
                                call.data[5], call.data[6], call.x[7], call.x[8], call.x[9], steps,
                                call.x[11], space, &network);
            acquire(released);
            call.result = PyLong_FromLong(taken);
        } else
            PyErr_NoMemory();
        PyMem_Free(space);
    }
    return end(&call);
}

static PyObject *py_interpolate(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "dddiD") && sized(&call, 2, call.size[1])
        && sized(&call, 4, call.size[0])) {
        if (call.size[1] > 1 && call.size[3] > 0) {
            PyThreadState *released = release(10.0 * call.size[0]);
            interpolate(call.data[0], call.size[0], call.data[1], call.data[2], call.size[1],
                        call.data[3], call.size[3], call.data[4]);
            acquire(released);
            call.result = Py_NewRef(Py_None);
        } else
            PyErr_SetString(PyExc_ValueError, "kernel: a table must have two points or more");
    }
    return end(&call);
}

static PyObject *py_convolve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnnnffF")) {
        Py_ssize_t rows = call.size[0], cols = call.size[1];
        Py_ssize_t channels = call.size[2], dilation = call.size[3];
        for (int k = 0; k < 4; k++)
            if (call.size[k] < 1 || call.size[k] > MOST_SIZE) {
                PyErr_Format(PyExc_ValueError, "kernel: argument %d: %zd: must be 1 to %d", k,
                             call.size[k], MOST_SIZE);
                return end(&call);
            }
        Py_ssize_t width = 9 * channels + 1, n_out = call.size[5] / width;
        if (sized(&call, 4, channels * rows * cols) && sized(&call, 5, n_out * width)
            && sized(&call, 6, n_out * rows * cols)) {
            Py_ssize_t size = convolve_space(channels, rows, cols, dilation);
            float *space = PyMem_Calloc(size, sizeof *space);
            if (space) {
                PyThreadState *released = release((double)call.size[5] * rows * cols / 8.0);
                convolve(channels, rows, cols, n_out, dilation, call.data[4], call.data[5],
                         call.data[6], space);
                acquire(released);
                call.result = Py_NewRef(Py_None);
            } else
                PyErr_NoMemory();
            PyMem_Free(space);
        }
    }
    return end(&call);
}

#define METHOD(name, text) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    METHOD(two_terminal, "(rows, cols, g, rho) -> whether it was regular; fills rho"),
    METHOD(network, "(rows, cols, g, root, k, rho) -> whether it was regular; fills the last three"),
    METHOD(sensitivity, "(rows, cols, k, weight, told, one, other, out); fills out"),
    METHOD(hessian_product, "(rows, cols, k, p, out); fills out"),
    METHOD(roughness, "(rows, cols, x, weight, square, gradient, diagonal, entries) -> cost; fills "
                      "the last three"),
    METHOD(interpolate, "(x, points, values, start, out); fills out"),
    METHOD(convolve, "(rows, cols, channels, dilation, picture, layer, out); fills out"),
    METHOD(solve_in_box, "(precision, b, low, high, dx, factor, inside) -> number inside, -1 if it "
                         "was singular; fills the last three"),
    METHOD(iterate, "(rows, cols, g, at, measured, low, high, r_ref, r_par, goal, steps, seconds) "
                    "-> steps taken, -1 if it was singular; changes g"),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "_kernel",
    .m_doc = "The inner loops, compiled; kernel/kernel.h.",
    .m_methods = methods,
};

PyMODINIT_FUNC PyInit__kernel(void)
{
    PyObject *module = PyModule_Create(&definition);

    if (module && (PyModule_AddIntConstant(module, "LINES", LINES) < 0 ||
                   PyModule_AddIntConstant(module, "SOURCES", SOURCES) < 0))
        Py_CLEAR(module);
    return module;
}
