/* x' = A x + B u, y = C x + D u: variables of one instance, derivatives, outputs, and exact steps for constant inputs.

   Every function is static, so that several units fit in one program. model_data.h has the numbers: NX states, NU inputs,
   NY outputs, the matrices by compressed rows, SCALE, which makes the rows and columns of A of one size, and NOMINAL, the
   size of the states. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model_data.h"

/* Names that a program may put a prefix to, and that a library shows. */
#define PASTE_NAMES(a, b) a##b
#define PASTE(a, b) PASTE_NAMES(a, b)
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* Value references: time, states, their derivatives, inputs, outputs. */
#define FIRST_X 1
#define FIRST_DX (FIRST_X + NX)
#define FIRST_U (FIRST_DX + NX)
#define FIRST_Y (FIRST_U + NU)
#define END (FIRST_Y + NY)

/* Steps that differ by less are one step: a caller's sums of times differ by round-off. */
#define SAME_STEP 1e-12
/* Terms of the series below 2^-53 for a norm of 1/2. */
#define TERMS 15

/* Any function; each version of the standard has its own logger. */
typedef void (*Function)(void);

typedef struct {
    double time;
    /* One more, because C has no arrays of length 0. */
    double x[NX + 1];
    double u[NU + 1];
} Values;

typedef struct {
    Values now;
    /* Change of the states and effect of the inputs over one step h, row by row. */
    double h;
    double *E;
    double *G;
    void *environment;
    Function logger;
    const char *name;
} Model;

static void multiply_add(const Rows *matrix, const double *v, double *out)
{
    for (int i = 0; i < matrix->rows; i++)
        for (int k = matrix->start[i]; k < matrix->start[i + 1]; k++)
            out[i] += matrix->value[k] * v[matrix->column[k]];
}

static void transposed_multiply_add(const Rows *matrix, const double *v, double *out)
{
    for (int i = 0; i < matrix->rows; i++)
        for (int k = matrix->start[i]; k < matrix->start[i + 1]; k++)
            out[matrix->column[k]] += matrix->value[k] * v[i];
}

static void derivatives(const Values *at, double *dx)
{
    memset(dx, 0, sizeof(double) * NX);
    multiply_add(&A, at->x, dx);
    multiply_add(&B, at->u, dx);
}

static void outputs(const Values *at, double *y)
{
    memset(y, 0, sizeof(double) * NY);
    multiply_add(&C, at->x, y);
    multiply_add(&D, at->u, y);
}

/* Values of variables by their references; 0 if all are known. */
static int get_values(const Model *model, const unsigned int *reference, size_t count, double *value)
{
    double dx[NX + 1], y[NY + 1];
    derivatives(&model->now, dx);
    outputs(&model->now, y);
    for (size_t i = 0; i < count; i++) {
        unsigned int r = reference[i];
        if (r >= END)
            return 1;
        value[i] = r >= FIRST_Y    ? y[r - FIRST_Y]
                   : r >= FIRST_U  ? model->now.u[r - FIRST_U]
                   : r >= FIRST_DX ? dx[r - FIRST_DX]
                   : r >= FIRST_X  ? model->now.x[r - FIRST_X]
                                   : model->now.time;
    }
    return 0;
}

/* States and inputs can be set; 0 if all are such. */
static int set_values(Model *model, const unsigned int *reference, size_t count, const double *value)
{
    for (size_t i = 0; i < count; i++) {
        unsigned int r = reference[i];
        if (r >= FIRST_U && r < FIRST_Y)
            model->now.u[r - FIRST_U] = value[i];
        else if (r >= FIRST_X && r < FIRST_DX)
            model->now.x[r - FIRST_X] = value[i];
        else
            return 1;
    }
    return 0;
}

/* Sensitivity of derivatives and outputs to states and inputs times a seed, or the transpose of it; 0 if all are such. */
static int directional_derivative(const unsigned int *unknown, size_t unknowns, const unsigned int *known,
                                  size_t knowns, const double *seed, double *sensitivity, int adjoint)
{
    double x[NX + 1], u[NU + 1], dx[NX + 1], y[NY + 1];
    memset(x, 0, sizeof x), memset(u, 0, sizeof u), memset(dx, 0, sizeof dx), memset(y, 0, sizeof y);
    for (size_t i = 0; i < unknowns; i++) {
        unsigned int r = unknown[i];
        if (r < FIRST_DX || r >= END || (r >= FIRST_U && r < FIRST_Y))
            return 1;
        if (adjoint)
            *(r >= FIRST_Y ? &y[r - FIRST_Y] : &dx[r - FIRST_DX]) += seed[i];
    }
    for (size_t i = 0; i < knowns; i++) {
        unsigned int r = known[i];
        if (r < FIRST_X || r >= FIRST_Y || (r >= FIRST_DX && r < FIRST_U))
            return 1;
        if (!adjoint)
            *(r >= FIRST_U ? &u[r - FIRST_U] : &x[r - FIRST_X]) += seed[i];
    }
    if (adjoint) {
        transposed_multiply_add(&A, dx, x), transposed_multiply_add(&C, y, x);
        transposed_multiply_add(&B, dx, u), transposed_multiply_add(&D, y, u);
        for (size_t i = 0; i < knowns; i++)
            sensitivity[i] = known[i] >= FIRST_U ? u[known[i] - FIRST_U] : x[known[i] - FIRST_X];
    } else {
        multiply_add(&A, x, dx), multiply_add(&B, u, dx);
        multiply_add(&C, x, y), multiply_add(&D, u, y);
        for (size_t i = 0; i < unknowns; i++)
            sensitivity[i] = unknown[i] >= FIRST_Y ? y[unknown[i] - FIRST_Y] : dx[unknown[i] - FIRST_DX];
    }
    return 0;
}

/* out += factor * a b, all NX by NX. Zeros are skipped: modes that no damping couples stay apart. */
static void product_add(double factor, const double *a, const double *b, double *out)
{
    for (int i = 0; i < NX; i++)
        for (int k = 0; k < NX; k++) {
            double share = factor * a[i * NX + k];
            if (share != 0.0)
                for (int j = 0; j < NX; j++)
                    out[i * NX + j] += share * b[k * NX + j];
        }
}

/* Prepare E = exp(A h) - 1 and G = int_0^h exp(A s) ds B. Both come from P = sum z^k / (k + 1)!, with E = z P, for
   z = A h / 2^doublings, and P(2 z) = P + E P / 2, E(2 z) = 2 E + E E. Without the 1 in E, slow modes keep their digits
   beside fast ones. 0 if there was memory. */
static int prepare(Model *model, double h)
{
    const size_t square = sizeof(double) * NX * NX;
    if (NX == 0 || (model->E && fabs(h - model->h) <= SAME_STEP * fabs(h)))
        return 0;
    double *z = calloc(1, square), *P = calloc(1, square), *E = calloc(1, square), *next = calloc(1, square);
    if (!model->E)
        model->E = malloc(square), model->G = malloc(sizeof(double) * NX * (NU + 1));
    if (!z || !P || !E || !next || !model->E || !model->G) {
        free(z), free(P), free(E), free(next), free(model->E), free(model->G);
        model->E = model->G = NULL;
        return 1;
    }
    double norm = 0.0;
    for (int i = 0; i < NX; i++) {
        double row = 0.0;
        for (int k = A.start[i]; k < A.start[i + 1]; k++) {
            double entry = A.value[k] * SCALE[A.column[k]] / SCALE[i] * h;
            z[i * NX + A.column[k]] = entry;
            row += fabs(entry);
        }
        norm = fmax(norm, row);
    }
    int doublings = norm > 0.5 ? (int)ceil(log2(norm)) + 1 : 0;
    for (int i = 0; i < NX * NX; i++)
        z[i] = ldexp(z[i], -doublings);
    for (int term = TERMS; term > 0; term--) {
        memset(next, 0, square);
        for (int i = 0; i < NX; i++)
            next[i * NX + i] = 1.0;
        if (term < TERMS)
            product_add(1.0 / (term + 1), z, P, next);
        memcpy(P, next, square);
    }
    product_add(1.0, z, P, E);
    for (int k = 0; k < doublings; k++) {
        memcpy(next, P, square);
        product_add(0.5, E, P, next);
        memcpy(P, next, square);
        for (int i = 0; i < NX * NX; i++)
            next[i] = 2.0 * E[i];
        product_add(1.0, E, E, next);
        memcpy(E, next, square);
    }
    memset(model->G, 0, sizeof(double) * NX * (NU + 1));
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) {
            double share = P[i * NX + j] * SCALE[i] / SCALE[j];
            model->E[i * NX + j] = E[i * NX + j] * SCALE[i] / SCALE[j];
            if (share != 0.0)
                for (int k = B.start[j]; k < B.start[j + 1]; k++)
                    model->G[i * NU + B.column[k]] += h * share * B.value[k];
        }
    model->h = h;
    free(z), free(P), free(E), free(next);
    return 0;
}

/* One step with the inputs as they are; 0 if it was done. */
static int step(Model *model, double from, double h)
{
    double change[NX + 1];
    if (!(h >= 0.0) || prepare(model, h))
        return 1;
    for (int i = 0; i < NX; i++) {
        change[i] = 0.0;
        for (int j = 0; j < NX; j++)
            change[i] += model->E[i * NX + j] * model->now.x[j];
        for (int j = 0; j < NU; j++)
            change[i] += model->G[i * NU + j] * model->now.u[j];
    }
    for (int i = 0; i < NX; i++)
        model->now.x[i] += change[i];
    model->now.time = from + h;
    return 0;
}

static Model *new_model(const char *name, const char *token, void *environment, Function logger)
{
    if (!token || strcmp(token, TOKEN))
        return NULL;
    Model *model = calloc(1, sizeof(Model));
    if (!model)
        return NULL;
    model->name = name, model->environment = environment, model->logger = logger;
    return model;
}

static void free_model(Model *model)
{
    if (model)
        free(model->E), free(model->G), free(model);
}
