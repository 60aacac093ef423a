/* Functional Mock-up Interface 3.0 of linear_model.h, for model exchange and co-simulation. */

#include <stdbool.h>
#include <stdint.h>

#include "linear_model.h"

#if defined(FMI3_FUNCTION_PREFIX)
#define FMI3(name) PASTE(FMI3_FUNCTION_PREFIX, name)
#else
#define FMI3(name) name
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } Status;
typedef void (*Logger)(void *, Status, const char *, const char *);
typedef uint32_t Reference;
typedef const char *String;
typedef const uint8_t *Binary;

static Status answer(const Model *model, int failed, const char *message)
{
    if (!failed)
        return fmi3OK;
    if (model->logger)
        ((Logger)model->logger)(model->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

/* Names and types of the calls that both versions have. */
#define CALL(name) FMI3(fmi3##name)
#define STATE_CALL(verb, rest) FMI3(fmi3##verb##FMUState##rest)
#define DESERIALIZE STATE_CALL(Deserialize, )
#define DERIVATIVES FMI3(fmi3GetContinuousStateDerivatives)
typedef uint8_t Byte;
#include "calls.h"

static Model *instantiate(String name, String token, void *environment, Logger logger)
{
    Model *model = new_model(name, token, environment, (Function)logger);
    if (!model && logger)
        logger(environment, fmi3Error, "logStatusError", "the instantiation token is another, or no memory");
    return model;
}

EXPORT String FMI3(fmi3GetVersion)(void) { return "3.0"; }
EXPORT Status FMI3(fmi3SetDebugLogging)(Model *m, bool on, size_t n, const String categories[])
{
    (void)m, (void)on, (void)n, (void)categories;
    return fmi3OK;
}
EXPORT Model *FMI3(fmi3InstantiateModelExchange)(String name, String token, String resources, bool visible,
                                                 bool logging, void *environment, Logger logger)
{
    (void)resources, (void)visible, (void)logging;
    return instantiate(name, token, environment, logger);
}
EXPORT Model *FMI3(fmi3InstantiateCoSimulation)(String name, String token, String resources, bool visible,
                                                bool logging, bool event_mode, bool early_return,
                                                const Reference intermediate[], size_t intermediates,
                                                void *environment, Logger logger, void (*update)(void))
{
    (void)resources, (void)visible, (void)logging, (void)early_return, (void)intermediate, (void)update;
    if (event_mode || intermediates > 0) {
        if (logger)
            logger(environment, fmi3Error, "logStatusError", "there is no event mode and no intermediate update");
        return NULL;
    }
    return instantiate(name, token, environment, logger);
}
EXPORT Model *FMI3(fmi3InstantiateScheduledExecution)(String name, String token, String resources, bool visible,
                                                      bool logging, void *environment, Logger logger,
                                                      void (*update)(void), void (*lock)(void), void (*unlock)(void))
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    if (logger)
        logger(environment, fmi3Error, "logStatusError", "there is no scheduled execution");
    return NULL;
}
EXPORT Status FMI3(fmi3EnterInitializationMode)(Model *m, bool tolerance_defined, double tolerance, double start,
                                                bool stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    m->now.time = start;
    return fmi3OK;
}

EXPORT Status FMI3(fmi3GetFloat64)(Model *m, const Reference r[], size_t n, double value[], size_t values)
{
    return answer(m, values != n || get_values(m, r, n, value), "fmi3GetFloat64: a value reference is unknown");
}
EXPORT Status FMI3(fmi3SetFloat64)(Model *m, const Reference r[], size_t n, const double value[], size_t values)
{
    return answer(m, values != n || set_values(m, r, n, value),
                  "fmi3SetFloat64: a variable is no state and no input");
}

/* There are no variables of other types. */
#define NO_VARIABLES(Type, type)                                                                             \
    EXPORT Status FMI3(fmi3Get##Type)(Model *m, const Reference r[], size_t n, type value[], size_t values)  \
    {                                                                                                        \
        (void)r, (void)value, (void)values;                                                                  \
        return answer(m, n > 0, "all variables are of type Float64");                                        \
    }                                                                                                        \
    EXPORT Status FMI3(fmi3Set##Type)(Model *m, const Reference r[], size_t n, const type value[], size_t values) \
    {                                                                                                        \
        (void)r, (void)value, (void)values;                                                                  \
        return answer(m, n > 0, "all variables are of type Float64");                                        \
    }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, String)
EXPORT Status FMI3(fmi3GetBinary)(Model *m, const Reference r[], size_t n, size_t size[], Binary value[], size_t values)
{
    (void)r, (void)size, (void)value, (void)values;
    return answer(m, n > 0, "all variables are of type Float64");
}
EXPORT Status FMI3(fmi3SetBinary)(Model *m, const Reference r[], size_t n, const size_t size[], const Binary value[],
                                  size_t values)
{
    (void)r, (void)size, (void)value, (void)values;
    return answer(m, n > 0, "all variables are of type Float64");
}
EXPORT Status FMI3(fmi3GetClock)(Model *m, const Reference r[], size_t n, bool value[])
{
    (void)r, (void)value;
    return answer(m, n > 0, "there are no clocks");
}
EXPORT Status FMI3(fmi3SetClock)(Model *m, const Reference r[], size_t n, const bool value[])
{
    (void)r, (void)value;
    return answer(m, n > 0, "there are no clocks");
}

EXPORT Status FMI3(fmi3GetNumberOfVariableDependencies)(Model *m, Reference r, size_t *count)
{
    (void)r, (void)count;
    return answer(m, 1, "dependencies are in modelDescription.xml");
}
EXPORT Status FMI3(fmi3GetVariableDependencies)(Model *m, Reference r, size_t element[], Reference independent[],
                                                size_t other[], int kind[], size_t count)
{
    (void)r, (void)element, (void)independent, (void)other, (void)kind, (void)count;
    return answer(m, 1, "dependencies are in modelDescription.xml");
}

EXPORT Status FMI3(fmi3GetDirectionalDerivative)(Model *m, const Reference unknown[], size_t unknowns,
                                                 const Reference known[], size_t knowns, const double seed[],
                                                 size_t seeds, double sensitivity[], size_t sensitivities)
{
    int odd = seeds != knowns || sensitivities != unknowns;
    return answer(m, odd || directional_derivative(unknown, unknowns, known, knowns, seed, sensitivity, 0),
                  "derivatives are those of state derivatives and outputs, by states and inputs");
}
EXPORT Status FMI3(fmi3GetAdjointDerivative)(Model *m, const Reference unknown[], size_t unknowns,
                                             const Reference known[], size_t knowns, const double seed[],
                                             size_t seeds, double sensitivity[], size_t sensitivities)
{
    int odd = seeds != unknowns || sensitivities != knowns;
    return answer(m, odd || directional_derivative(unknown, unknowns, known, knowns, seed, sensitivity, 1),
                  "derivatives are those of state derivatives and outputs, by states and inputs");
}

EXPORT Status FMI3(fmi3EnterConfigurationMode)(Model *m) { return answer(m, 1, "there are no structural parameters"); }
EXPORT Status FMI3(fmi3ExitConfigurationMode)(Model *m) { return answer(m, 1, "there are no structural parameters"); }

#define NO_CLOCK(name, ...)                                                                                  \
    EXPORT Status FMI3(name)(Model *m, const Reference r[], size_t n, __VA_ARGS__)                           \
    {                                                                                                        \
        (void)r;                                                                                             \
        return answer(m, n > 0, "there are no clocks");                                                      \
    }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NO_CLOCK(fmi3GetIntervalDecimal, double interval[], int qualifier[])
NO_CLOCK(fmi3GetIntervalFraction, uint64_t counter[], uint64_t resolution[], int qualifier[])
NO_CLOCK(fmi3GetShiftDecimal, double shift[])
NO_CLOCK(fmi3GetShiftFraction, uint64_t counter[], uint64_t resolution[])
NO_CLOCK(fmi3SetIntervalDecimal, const double interval[])
NO_CLOCK(fmi3SetIntervalFraction, const uint64_t counter[], const uint64_t resolution[])
NO_CLOCK(fmi3SetShiftDecimal, const double shift[])
NO_CLOCK(fmi3SetShiftFraction, const uint64_t counter[], const uint64_t resolution[])

EXPORT Status FMI3(fmi3EvaluateDiscreteStates)(Model *m) { (void)m; return fmi3OK; }
EXPORT Status FMI3(fmi3UpdateDiscreteStates)(Model *m, bool *update, bool *terminate, bool *nominals, bool *values,
                                             bool *next_defined, double *next)
{
    (void)m;
    *update = *terminate = *nominals = *values = *next_defined = false;
    *next = 0.0;
    return fmi3OK;
}

EXPORT Status FMI3(fmi3CompletedIntegratorStep)(Model *m, bool no_return, bool *enter_event_mode, bool *terminate)
{
    (void)m, (void)no_return;
    *enter_event_mode = *terminate = false;
    return fmi3OK;
}
EXPORT Status FMI3(fmi3GetNumberOfEventIndicators)(Model *m, size_t *n)
{
    (void)m;
    *n = 0;
    return fmi3OK;
}
EXPORT Status FMI3(fmi3GetNumberOfContinuousStates)(Model *m, size_t *n)
{
    (void)m;
    *n = NX;
    return fmi3OK;
}

EXPORT Status FMI3(fmi3EnterStepMode)(Model *m) { (void)m; return fmi3OK; }
EXPORT Status FMI3(fmi3GetOutputDerivatives)(Model *m, const Reference r[], size_t n, const int32_t order[],
                                             double value[], size_t values)
{
    (void)r, (void)n, (void)order, (void)value, (void)values;
    return answer(m, 1, "there are no derivatives of outputs");
}
EXPORT Status FMI3(fmi3DoStep)(Model *m, double from, double h, bool no_return, bool *event, bool *terminate,
                               bool *early_return, double *last_time)
{
    (void)no_return;
    int failed = step(m, from, h);
    *event = *terminate = *early_return = false;
    *last_time = m->now.time;
    return answer(m, failed, "a step is negative, or there is no memory");
}
EXPORT Status FMI3(fmi3ActivateModelPartition)(Model *m, Reference clock, double time)
{
    (void)clock, (void)time;
    return answer(m, 1, "there is no scheduled execution");
}
