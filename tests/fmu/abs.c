/* A wheel-slip (anti-lock) controller with a yaw-moment share, as a co-simulation FMU of FMI 2.0 or 3.0 (-DFMI=2|3).
 *
 * Each wheel has a pressure ratio in [floor, 1]. Slip above `slip_high` lets it fall with `release_per_s`, below
 * `slip_low` it rises with `build_per_s`; below `off_below_km_h` the driver has it all. The yaw share takes
 * `yaw_gain_s` times the yaw rate's deviation from 0 off the front wheel on the inside of it.
 * For tests of the host it can be told to misbehave: `fault` at `fault_time_s`. */
#include "fmi.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SPEED, YAW_RATE, SPIN, RATIO = 6, ACTIVE = 10, SLIP_LOW, SLIP_HIGH, RELEASE, BUILD, FLOOR, RADIUS, OFF_BELOW,
       YAW_GAIN, FAULT_TIME, FAULT, LABEL, ENABLED, TIME, REFERENCES };
enum { FAULT_NONE, FAULT_NAN, FAULT_CRASH, FAULT_SLEEP, FAULT_LOOP, FAULT_ERROR, FAULT_EXIT, FAULT_LATE };

typedef struct {
    double real[REFERENCES];
    int active, fault, enabled, faulted;
    double ratio[4];
#if FMI == 2
    Callbacks callbacks;
#else
    Logger logger;
    void *environment;
#endif
} Model;

static void start(Model *m) {
    static const double parameters[] = {0.08, 0.15, 12.0, 4.0, 0.05, 0.3, 8.0, 0.5, 0.0};
    memset(m->real, 0, sizeof m->real);
    memcpy(m->real + SLIP_LOW, parameters, sizeof parameters);
    m->active = 0, m->fault = FAULT_NONE, m->enabled = 1, m->faulted = 0;
    for (int i = 0; i < 4; i++) m->ratio[i] = m->real[RATIO + i] = 1.0;
}

static void say(Model *m, const char *text) {
#if FMI == 2
    if (m->callbacks.logger) m->callbacks.logger(m->callbacks.environment, "abs", Error, "error", text);
#else
    if (m->logger) m->logger(m->environment, Error, "error", text);
#endif
}

static int *volatile nowhere;

/* In the tenth of a second behind `fault_time_s`: an instance that is made later is sound. */
static Status misbehave(Model *m, double end) {
    double since = end - m->real[FAULT_TIME];
    if (m->fault == FAULT_NONE || since < 0.0 || since > 0.1) return Ok;
    int first = !m->faulted;
    m->faulted = 1;
    switch (m->fault) {
    case FAULT_NAN:
        if (since < 0.005) m->real[RATIO] = NAN;
        return Ok;
    case FAULT_CRASH: *nowhere = 1; return Ok;
    case FAULT_SLEEP: if (first) sleep(2); return Ok;
    case FAULT_LOOP: for (volatile int i = 0;; i++) {}
    case FAULT_ERROR: say(m, "told to fail"); return Error;
    case FAULT_EXIT: _exit(7);
    case FAULT_LATE: usleep(4000); return Ok;
    }
    return Ok;
}

static Status step(Model *m, double time, double h) {
    double v = m->real[SPEED] / 3.6; /* km/h */
#ifdef ALLOCATE
    void *volatile block = malloc(64);
    free(block);
#endif
    int active = 0;
    for (int i = 0; i < 4; i++) {
        double slip = 1.0 - m->real[RADIUS] * m->real[SPIN + i] / fmax(v, 0.5);
        if (!m->enabled || m->real[SPEED] < m->real[OFF_BELOW]) slip = 0.0;
        if (slip > m->real[SLIP_HIGH]) {
            m->ratio[i] -= m->real[RELEASE] * h;
            active |= 1 << i;
        } else if (slip < m->real[SLIP_LOW]) {
            m->ratio[i] += m->real[BUILD] * h;
        }
        m->ratio[i] = fmin(fmax(m->ratio[i], m->real[FLOOR]), 1.0);
        double share = 0.0;
        if (i < 2) share = fmax(m->real[YAW_GAIN] * m->real[YAW_RATE] * (i == 0 ? 1.0 : -1.0), 0.0);
        m->real[RATIO + i] = fmax(m->ratio[i] - share, m->real[FLOOR]);
    }
    m->active = active;
    m->real[TIME] = time + h;
    return misbehave(m, time + h);
}

#if FMI == 2
#define NAME(x) fmi2##x
#else
#define NAME(x) fmi3##x
#endif

#ifdef WITHOUT_STEP
#define DO_STEP not_a_step
#else
#define DO_STEP NAME(DoStep)
#endif

const char *NAME(GetVersion)(void) { return FMI == 2 ? "2.0" : "3.0"; }

#if FMI == 2
const char *fmi2GetTypesPlatform(void) { return "default"; }

Instance fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                         const Callbacks *callbacks, int visible, int logging) {
    (void)name, (void)resources, (void)visible, (void)logging;
    if (type != 1 || !callbacks || strcmp(guid, TOKEN) != 0) return NULL;
    Model *m = callbacks->allocate(1, sizeof *m);
    if (!m) return NULL;
    m->callbacks = *callbacks;
    start(m);
    return m;
}
void fmi2FreeInstance(Instance c) { if (c) ((Model *)c)->callbacks.release(c); }
Status fmi2SetupExperiment(Instance c, int t, double tolerance, double begin, int s, double stop) {
    (void)t, (void)tolerance, (void)begin, (void)s, (void)stop;
    return c ? Ok : Error;
}
Status fmi2EnterInitializationMode(Instance c) { return c ? Ok : Error; }
Status DO_STEP(Instance c, double time, double h, int no_set_prior) { (void)no_set_prior; return step(c, time, h); }
Status fmi2CancelStep(Instance c) { (void)c; return Error; }
#else
Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                     bool logging, bool event_mode, bool early_return, const Reference *required,
                                     size_t required_len, void *environment, Logger logger, void *update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return;
    (void)required, (void)required_len, (void)update;
    if (strcmp(token, TOKEN) != 0) return NULL;
    Model *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->logger = logger, m->environment = environment;
    start(m);
    return m;
}
void fmi3FreeInstance(Instance c) { free(c); }
Status fmi3EnterInitializationMode(Instance c, bool t, double tolerance, double begin, bool s, double stop) {
    (void)t, (void)tolerance, (void)begin, (void)s, (void)stop;
    return c ? Ok : Error;
}
Status DO_STEP(Instance c, double time, double h, bool no_set_prior, bool *event, bool *end, bool *early,
                  double *last) {
    (void)no_set_prior;
    *event = *end = *early = false;
    *last = time + h;
    return step(c, time, h);
}
/* The rest of the interface, which this model has no use for; importers look the names up all the same. */
#define NONE(name) Status name(void) { return Error; }
Instance fmi3InstantiateModelExchange(void) { return NULL; }
Instance fmi3InstantiateScheduledExecution(void) { return NULL; }
NONE(fmi3EnterEventMode) NONE(fmi3GetBinary) NONE(fmi3SetBinary) NONE(fmi3GetClock) NONE(fmi3SetClock)
NONE(fmi3GetNumberOfVariableDependencies) NONE(fmi3GetVariableDependencies) NONE(fmi3GetFMUState)
NONE(fmi3SetFMUState) NONE(fmi3FreeFMUState) NONE(fmi3SerializedFMUStateSize) NONE(fmi3SerializeFMUState)
NONE(fmi3DeserializeFMUState) NONE(fmi3GetDirectionalDerivative) NONE(fmi3GetAdjointDerivative)
NONE(fmi3EnterConfigurationMode) NONE(fmi3ExitConfigurationMode) NONE(fmi3GetIntervalDecimal)
NONE(fmi3GetIntervalFraction) NONE(fmi3GetShiftDecimal) NONE(fmi3GetShiftFraction) NONE(fmi3SetIntervalDecimal)
NONE(fmi3SetIntervalFraction) NONE(fmi3SetShiftDecimal) NONE(fmi3SetShiftFraction) NONE(fmi3EvaluateDiscreteStates)
NONE(fmi3UpdateDiscreteStates) NONE(fmi3EnterContinuousTimeMode) NONE(fmi3CompletedIntegratorStep) NONE(fmi3SetTime)
NONE(fmi3SetContinuousStates) NONE(fmi3GetContinuousStateDerivatives) NONE(fmi3GetEventIndicators)
NONE(fmi3GetContinuousStates) NONE(fmi3GetNominalsOfContinuousStates) NONE(fmi3GetNumberOfEventIndicators)
NONE(fmi3GetNumberOfContinuousStates) NONE(fmi3EnterStepMode) NONE(fmi3GetOutputDerivatives)
NONE(fmi3ActivateModelPartition)
#endif

Status NAME(SetDebugLogging)(Instance c, Boolean on, size_t n, const char *const categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return Ok;
}
Status NAME(ExitInitializationMode)(Instance c) { return c ? Ok : Error; }
Status NAME(Terminate)(Instance c) { return c ? Ok : Error; }
Status NAME(Reset)(Instance c) { start(c); return Ok; }

#if FMI == 2
#define LENGTH
#define FLOATS(way) fmi2##way##Real
#define INTS(way) fmi2##way##Integer
#else
#define LENGTH , size_t values
#define FLOATS(way) fmi3##way##Float64
#define INTS(way) fmi3##way##Int32
#endif

Status FLOATS(Get)(Instance c, const Reference r[], size_t n, double value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if ((r[i] >= FAULT && r[i] != TIME) || r[i] == ACTIVE) return Error;
        value[i] = ((Model *)c)->real[r[i]];
    }
    return Ok;
}
Status FLOATS(Set)(Instance c, const Reference r[], size_t n, const double value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= FAULT || (r[i] >= RATIO && r[i] <= ACTIVE)) return Error;
        ((Model *)c)->real[r[i]] = value[i];
    }
    return Ok;
}
Status INTS(Get)(Instance c, const Reference r[], size_t n, int value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] != ACTIVE && r[i] != FAULT) return Error;
        value[i] = r[i] == ACTIVE ? ((Model *)c)->active : ((Model *)c)->fault;
    }
    return Ok;
}
Status INTS(Set)(Instance c, const Reference r[], size_t n, const int value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] != FAULT) return Error;
        ((Model *)c)->fault = value[i];
    }
    return Ok;
}
Status NAME(GetBoolean)(Instance c, const Reference r[], size_t n, Boolean value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] != ENABLED) return Error;
        value[i] = ((Model *)c)->enabled;
    }
    return Ok;
}
Status NAME(SetBoolean)(Instance c, const Reference r[], size_t n, const Boolean value[] LENGTH) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] != ENABLED) return Error;
        ((Model *)c)->enabled = value[i];
    }
    return Ok;
}
Status NAME(GetString)(Instance c, const Reference r[], size_t n, const char *value[] LENGTH) {
    (void)c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] != LABEL) return Error;
        value[i] = "abs";
    }
    return Ok;
}
Status NAME(SetString)(Instance c, const Reference r[], size_t n, const char *const value[] LENGTH) {
    (void)c, (void)value;
    for (size_t i = 0; i < n; i++)
        if (r[i] != LABEL) return Error;
    return Ok;
}

#if FMI == 2
#define NONE2(name) Status name(void) { return Error; }
NONE2(fmi2GetFMUstate) NONE2(fmi2SetFMUstate) NONE2(fmi2FreeFMUstate) NONE2(fmi2SerializedFMUstateSize)
NONE2(fmi2SerializeFMUstate) NONE2(fmi2DeSerializeFMUstate) NONE2(fmi2GetDirectionalDerivative)
NONE2(fmi2SetRealInputDerivatives) NONE2(fmi2GetRealOutputDerivatives) NONE2(fmi2GetStatus) NONE2(fmi2GetRealStatus)
NONE2(fmi2GetIntegerStatus) NONE2(fmi2GetBooleanStatus) NONE2(fmi2GetStringStatus)
#else
#define TYPED(name, type) \
    Status fmi3Get##name(Instance c, const Reference r[], size_t n, type v[], size_t m) { (void)c, (void)r, (void)v, (void)m; return n ? Error : Ok; } \
    Status fmi3Set##name(Instance c, const Reference r[], size_t n, const type v[], size_t m) { (void)c, (void)r, (void)v, (void)m; return n ? Error : Ok; }
TYPED(Float32, float) TYPED(Int8, int8_t) TYPED(UInt8, uint8_t) TYPED(Int16, int16_t) TYPED(UInt16, uint16_t)
TYPED(UInt32, uint32_t) TYPED(Int64, int64_t) TYPED(UInt64, uint64_t)
#endif
