/* Functional Mock-up Interface 2.0 of linear_model.h, for model exchange and co-simulation. */

#include "linear_model.h"

#if defined(FMI2_FUNCTION_PREFIX)
#define FMI2(name) PASTE(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2(name) name
#endif

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } Status;
typedef void (*Logger)(void *, const char *, Status, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, Status);
    void *environment;
} Callbacks;
typedef struct {
    int newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged;
    int valuesOfContinuousStatesChanged, nextEventTimeDefined;
    double nextEventTime;
} EventInfo;

static Status answer(const Model *model, int failed, const char *message)
{
    if (!failed)
        return fmi2OK;
    if (model->logger)
        ((Logger)model->logger)(model->environment, model->name, fmi2Error, "logStatusError", "%s", message);
    return fmi2Error;
}

/* Names and types of the calls that both versions have. */
#define CALL(name) FMI2(fmi2##name)
#define STATE_CALL(verb, rest) FMI2(fmi2##verb##FMUstate##rest)
#define DESERIALIZE STATE_CALL(DeSerialize, )
#define DERIVATIVES FMI2(fmi2GetDerivatives)
typedef char Byte;
#include "calls.h"

EXPORT const char *FMI2(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT const char *FMI2(fmi2GetVersion)(void) { return "2.0"; }
EXPORT Status FMI2(fmi2SetDebugLogging)(Model *m, int on, size_t n, const char *const categories[])
{
    (void)m, (void)on, (void)n, (void)categories;
    return fmi2OK;
}
EXPORT Model *FMI2(fmi2Instantiate)(const char *name, int type, const char *token, const char *resources,
                                    const Callbacks *callbacks, int visible, int logging)
{
    (void)type, (void)resources, (void)visible, (void)logging;
    Logger logger = callbacks ? callbacks->logger : NULL;
    Model *model = new_model(name, token, callbacks ? callbacks->environment : NULL, (Function)logger);
    if (!model && logger)
        logger(callbacks->environment, name, fmi2Error, "logStatusError", "%s", "the GUID is another, or no memory");
    return model;
}
EXPORT Status FMI2(fmi2SetupExperiment)(Model *m, int tolerance_defined, double tolerance, double start,
                                        int stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    m->now.time = start;
    return fmi2OK;
}
EXPORT Status FMI2(fmi2EnterInitializationMode)(Model *m) { (void)m; return fmi2OK; }

EXPORT Status FMI2(fmi2GetReal)(Model *m, const unsigned int r[], size_t n, double value[])
{
    return answer(m, get_values(m, r, n, value), "fmi2GetReal: a value reference is unknown");
}
EXPORT Status FMI2(fmi2SetReal)(Model *m, const unsigned int r[], size_t n, const double value[])
{
    return answer(m, set_values(m, r, n, value), "fmi2SetReal: a variable is no state and no input");
}

/* There are no variables of other types. */
#define NO_VARIABLES(Type, type)                                                                             \
    EXPORT Status FMI2(fmi2Get##Type)(Model *m, const unsigned int r[], size_t n, type value[])              \
    {                                                                                                        \
        (void)r, (void)value;                                                                                \
        return answer(m, n > 0, "all variables are real");                                                   \
    }                                                                                                        \
    EXPORT Status FMI2(fmi2Set##Type)(Model *m, const unsigned int r[], size_t n, const type value[])        \
    {                                                                                                        \
        (void)r, (void)value;                                                                                \
        return answer(m, n > 0, "all variables are real");                                                   \
    }
typedef const char *String;
NO_VARIABLES(Integer, int)
NO_VARIABLES(Boolean, int)
NO_VARIABLES(String, String)

EXPORT Status FMI2(fmi2GetDirectionalDerivative)(Model *m, const unsigned int unknown[], size_t unknowns,
                                                 const unsigned int known[], size_t knowns, const double seed[],
                                                 double sensitivity[])
{
    return answer(m, directional_derivative(unknown, unknowns, known, knowns, seed, sensitivity, 0),
                  "derivatives are those of state derivatives and outputs, by states and inputs");
}

EXPORT Status FMI2(fmi2NewDiscreteStates)(Model *m, EventInfo *info)
{
    (void)m;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}
EXPORT Status FMI2(fmi2CompletedIntegratorStep)(Model *m, int no_return, int *enter_event_mode, int *terminate)
{
    (void)m, (void)no_return;
    *enter_event_mode = *terminate = 0;
    return fmi2OK;
}

EXPORT Status FMI2(fmi2SetRealInputDerivatives)(Model *m, const unsigned int r[], size_t n, const int order[],
                                                const double value[])
{
    (void)r, (void)n, (void)order, (void)value;
    return answer(m, 1, "inputs are constant over a step; take shorter steps");
}
EXPORT Status FMI2(fmi2GetRealOutputDerivatives)(Model *m, const unsigned int r[], size_t n, const int order[],
                                                 double value[])
{
    (void)r, (void)n, (void)order, (void)value;
    return answer(m, 1, "there are no derivatives of outputs");
}
EXPORT Status FMI2(fmi2DoStep)(Model *m, double from, double h, int no_return)
{
    (void)no_return;
    return answer(m, step(m, from, h), "a step is negative, or there is no memory");
}
EXPORT Status FMI2(fmi2CancelStep)(Model *m) { return answer(m, 1, "no step is pending"); }

/* A step is finished when fmi2DoStep returns. */
#define NO_STATUS(Kind, type)                                                                                \
    EXPORT Status FMI2(fmi2Get##Kind)(Model *m, int kind, type *value)                                       \
    {                                                                                                        \
        (void)m, (void)kind, (void)value;                                                                    \
        return fmi2Discard;                                                                                  \
    }
NO_STATUS(Status, Status)
NO_STATUS(RealStatus, double)
NO_STATUS(IntegerStatus, int)
NO_STATUS(BooleanStatus, int)
NO_STATUS(StringStatus, String)
