/* The Python module tactile_skin._kernel. Indices in arrays are trusted: its callers made them. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "kernel.h"

enum { MOST = 12 }; /* arguments */

/* The arguments of one call, in order: n an integer, x a number; arrays of d double, f float, i int,
 * b bool, in capitals if they are filled. */
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
    } formats[] = {{'d', 'd'}, {'f', 'f'}, {'i', 'i'}, {'b', '?'}};
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
    if (call->size[0] > 0 && call->size[1] > 0 && call->size[0] + call->size[1] <= LINES)
        return 1;
    PyErr_Format(PyExc_ValueError, "kernel: %zd x %zd: must be 1 to %d lines in all", call->size[0],
                 call->size[1], LINES);
    return 0;
}

static PyObject *end(Call *call)
{
    while (call->open)
        PyBuffer_Release(&call->views[--call->open]);
    return call->result;
}

#define ROWS ((int)call.size[0])
#define COLS ((int)call.size[1])

static PyObject *py_two_terminal(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network n;

    if (begin(&call, args, count, "nndD") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 3, ROWS * COLS)) {
        int regular = network_of(call.data[2], ROWS, COLS, &n) == 0;
        if (regular)
            two_terminal(ROWS, COLS, &n, call.data[3]);
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
        int regular = network_of(call.data[2], ROWS, COLS, &n) == 0;
        if (regular) {
            whole(ROWS, COLS, &n, call.data[3], call.data[4]);
            two_terminal(ROWS, COLS, &n, call.data[5]);
        }
        call.result = PyBool_FromLong(regular);
    }
    return end(&call);
}

static PyObject *py_hessian_product(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnddD") && skin(&call)
        && sized(&call, 2, (ROWS + COLS) * (ROWS + COLS)) && sized(&call, 3, ROWS * COLS)
        && sized(&call, 4, ROWS * COLS)) {
        hessian_product(ROWS, COLS, call.data[2], call.data[3], call.data[4]);
        call.result = Py_NewRef(Py_None);
    }
    return end(&call);
}

static PyObject *py_sensitivity(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "nnddiiiF") && skin(&call)
        && sized(&call, 2, (ROWS + COLS) * (ROWS + COLS)) && sized(&call, 3, ROWS * COLS)
        && sized(&call, 6, call.size[5]) && sized(&call, 7, call.size[4] * call.size[5])) {
        sensitivity(ROWS, COLS, call.data[2], call.data[3], call.data[4], call.size[4],
                    call.data[5], call.data[6], call.size[5], call.data[7]);
        call.result = Py_NewRef(Py_None);
    }
    return end(&call);
}

static PyObject *py_iterate(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network network;

    if (begin(&call, args, count, "nnDidddxxxn") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 4, call.size[3]) && sized(&call, 5, call.size[3])
        && sized(&call, 6, call.size[3])) {
        Py_ssize_t n = call.size[3];
        double *space = PyMem_Calloc(ITERATE_SPACE * n + 1, sizeof *space);
        if (space)
            call.result = PyLong_FromLong(iterate(
                ROWS, COLS, call.data[2], call.data[3], n, call.data[4], call.data[5], call.data[6],
                call.x[7], call.x[8], call.x[9], (int)call.size[10], space, &network));
        else
            PyErr_NoMemory();
        PyMem_Free(space);
    }
    return end(&call);
}

static PyObject *py_relax(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;
    Network network;

    if (begin(&call, args, count, "nnDdxxnD") && skin(&call) && sized(&call, 2, ROWS * COLS)
        && sized(&call, 3, ROWS * COLS) && sized(&call, 7, ROWS * COLS))
        call.result = PyBool_FromLong(relax(ROWS, COLS, call.data[2], call.data[3], call.x[4],
                                            call.x[5], (int)call.size[6], call.data[7], &network)
                                      == 0);
    return end(&call);
}

static PyObject *py_solve_in_box(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "fdddnDBF") && sized(&call, 0, call.size[1] * call.size[1])
        && sized(&call, 2, call.size[1]) && sized(&call, 3, call.size[1])
        && sized(&call, 5, call.size[1]) && sized(&call, 6, call.size[1])
        && sized(&call, 7, call.size[0])) {
        Py_ssize_t n = call.size[1];
        double *pull = PyMem_Malloc((n + 1) * sizeof *pull);
        ptrdiff_t *at = PyMem_Malloc((n + 1) * sizeof *at);
        if (pull && at)
            call.result = PyLong_FromSsize_t(
                solve_in_box(call.data[0], n, call.data[1], call.data[2], call.data[3],
                             (int)call.size[4], call.data[5], call.data[6], call.data[7], pull, at));
        else
            PyErr_NoMemory();
        PyMem_Free(pull);
        PyMem_Free(at);
    }
    return end(&call);
}

static PyObject *py_inverse_diagonal(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "fD") && sized(&call, 0, call.size[1] * call.size[1])) {
        float *row = PyMem_Malloc((call.size[1] + 1) * sizeof *row);
        if (row) {
            inverse_diagonal(call.data[0], call.size[1], row, call.data[1]);
            call.result = Py_NewRef(Py_None);
        } else
            PyErr_NoMemory();
        PyMem_Free(row);
    }
    return end(&call);
}

static PyObject *py_join(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "Fnidii") && sized(&call, 0, call.size[1] * call.size[1])
        && sized(&call, 4, call.size[3]) && sized(&call, 5, call.size[3])) {
        join(call.data[0], call.size[1], call.data[2], call.data[3], call.data[4], call.data[5],
             call.size[3]);
        call.result = Py_NewRef(Py_None);
    }
    return end(&call);
}

static PyObject *py_touches(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Call call;

    if (begin(&call, args, count, "dxiiiidDDD") && sized(&call, 2, 2 * call.size[3])
        && sized(&call, 5, call.size[4] / 4 * 6) && sized(&call, 6, 6)
        && sized(&call, 7, call.size[0]) && sized(&call, 8, call.size[0]))
        call.result = PyFloat_FromDouble(touches(
            call.data[0], call.size[0], call.x[1], call.data[2], call.data[3], call.size[3],
            call.data[4], call.data[5], call.size[4] / 4, call.data[6], call.data[7], call.data[8],
            call.data[9], call.size[9]));
    return end(&call);
}

#define METHOD(name, text) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    METHOD(two_terminal, "(rows, cols, g, rho) -> whether it was regular; fills rho"),
    METHOD(network, "(rows, cols, g, root, k, rho) -> whether it was regular; fills the last three"),
    METHOD(hessian_product, "(rows, cols, k, p, out); fills out"),
    METHOD(sensitivity, "(rows, cols, k, weight, told, one, other, out); fills out"),
    METHOD(iterate, "(rows, cols, g, at, measured, low, high, r_ref, r_par, goal, steps) -> steps "
                    "taken, -1 if it was singular; changes g"),
    METHOD(relax, "(rows, cols, g, measured, low, high, steps, rho) -> whether it was regular; "
                  "changes g, fills rho"),
    METHOD(solve_in_box, "(s, b, low, high, rounds, dx, inside, u) -> how many are inside, -1 "
                         "without a factor; fills the last three"),
    METHOD(inverse_diagonal, "(u, diagonal); fills diagonal"),
    METHOD(join, "(precision, n, place, entries, here, there); adds to precision"),
    METHOD(touches, "(x, x_rest, ends2, joins2, ends4, joins4, spreads, gradient, diagonal, "
                    "entries) -> cost; fills the last three"),
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

    if (module && PyModule_AddIntConstant(module, "LINES", LINES) < 0)
        Py_CLEAR(module);
    return module;
}
