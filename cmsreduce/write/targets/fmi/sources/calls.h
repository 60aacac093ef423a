/* Calls that versions 2.0 and 3.0 have alike. The file of a version names them by CALL, STATE_CALL, DESERIALIZE and
   DERIVATIVES, and has Status, Byte and answer. Its first status, 0, is success. */

EXPORT void CALL(FreeInstance)(Model *m) { free_model(m); }
EXPORT Status CALL(ExitInitializationMode)(Model *m) { return answer(m, 0, ""); }
EXPORT Status CALL(EnterEventMode)(Model *m) { return answer(m, 0, ""); }
EXPORT Status CALL(EnterContinuousTimeMode)(Model *m) { return answer(m, 0, ""); }
EXPORT Status CALL(Terminate)(Model *m) { return answer(m, 0, ""); }
EXPORT Status CALL(Reset)(Model *m)
{
    memset(&m->now, 0, sizeof m->now);
    return answer(m, 0, "");
}
EXPORT Status CALL(SetTime)(Model *m, double time)
{
    m->now.time = time;
    return answer(m, 0, "");
}

EXPORT Status CALL(SetContinuousStates)(Model *m, const double x[], size_t n)
{
    if (n == NX)
        memcpy(m->now.x, x, sizeof(double) * NX);
    return answer(m, n != NX, "another number of states");
}
EXPORT Status CALL(GetContinuousStates)(Model *m, double x[], size_t n)
{
    if (n == NX)
        memcpy(x, m->now.x, sizeof(double) * NX);
    return answer(m, n != NX, "another number of states");
}
EXPORT Status CALL(GetNominalsOfContinuousStates)(Model *m, double nominal[], size_t n)
{
    if (n == NX)
        memcpy(nominal, NOMINAL, sizeof(double) * NX);
    return answer(m, n != NX, "another number of states");
}
EXPORT Status DERIVATIVES(Model *m, double dx[], size_t n)
{
    if (n == NX)
        derivatives(&m->now, dx);
    return answer(m, n != NX, "another number of states");
}
EXPORT Status CALL(GetEventIndicators)(Model *m, double indicator[], size_t n)
{
    (void)indicator;
    return answer(m, n > 0, "there are no event indicators");
}

EXPORT Status STATE_CALL(Get, )(Model *m, Values **state)
{
    if (!*state)
        *state = malloc(sizeof(Values));
    if (*state)
        **state = m->now;
    return answer(m, !*state, "no memory");
}
EXPORT Status STATE_CALL(Set, )(Model *m, Values *state)
{
    m->now = *state;
    return answer(m, 0, "");
}
EXPORT Status STATE_CALL(Free, )(Model *m, Values **state)
{
    free(*state);
    *state = NULL;
    return answer(m, 0, "");
}
EXPORT Status STATE_CALL(Serialized, Size)(Model *m, Values *state, size_t *size)
{
    (void)state;
    *size = sizeof(Values);
    return answer(m, 0, "");
}
EXPORT Status STATE_CALL(Serialize, )(Model *m, Values *state, Byte bytes[], size_t size)
{
    if (size >= sizeof(Values))
        memcpy(bytes, state, sizeof(Values));
    return answer(m, size < sizeof(Values), "the array for the state is too small");
}
EXPORT Status DESERIALIZE(Model *m, const Byte bytes[], size_t size, Values **state)
{
    if (size != sizeof(Values))
        return answer(m, 1, "the bytes are no state of this unit");
    if (!*state)
        *state = malloc(sizeof(Values));
    if (*state)
        memcpy(*state, bytes, sizeof(Values));
    return answer(m, !*state, "no memory");
}
