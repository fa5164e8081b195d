/* The functions of FMI 2.0 on gt_fmu.h. */
#include "gt_fmu.h"

#include "fmi2Functions.h"

#include <stdlib.h>
#include <string.h>

#define F ((gt_fmu *)c)

static void say(const gt_fmu *f, gt_fmu_result result, const char *sentence)
{
    fmi2CallbackLogger logger;

    if (gt_fmu_is_said(f, result) == 0) {
        return;
    }
    logger = (fmi2CallbackLogger)f->logger;
    /* a sentence holds no sign of a format */
    logger(f->environment, f->name, (fmi2Status)result,
           (result == GT_FMU_DISCARD) ? "logStatusDiscard" : "logStatusError", sentence);
}

/* Where a pointer is NULL. */
static fmi2Status null(fmi2Component c, const char *call)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_refuse(F, GT_FMU_ERROR, call, "a pointer is NULL");
}

static fmi2Status unknown(fmi2Component c, const char *call, size_t n)
{
    if (n == 0U) {
        return fmi2OK;
    }
    return (fmi2Status)gt_fmu_refuse(F, GT_FMU_ERROR, call, "this model has none of these");
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    if (c == NULL) {
        return fmi2Error;
    }
    return (fmi2Status)gt_fmu_log(F, loggingOn, nCategories, categories);
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    void *(*allocate)(size_t, size_t) = calloc;
    gt_fmu *f;

    (void)fmuResourceLocation;
    (void)visible;
    if ((functions == NULL) || (instanceName == NULL) || (instanceName[0] == '\0')) {
        return NULL;
    }
    if ((fmuGUID == NULL) || (strcmp(fmuGUID, GT_FMU_TOKEN) != 0)) {
        if (functions->logger != NULL) {
            functions->logger(functions->componentEnvironment, instanceName, fmi2Error, "logStatusError",
                              "Instantiate: the guid is that of another model");
        }
        return NULL;
    }
    if (functions->allocateMemory != NULL) {
        allocate = functions->allocateMemory;
    }
    f = (gt_fmu *)allocate(1U, sizeof(gt_fmu));
    if (f == NULL) {
        return NULL;
    }
    f->say = say;
    f->logger = (void (*)(void))functions->logger;
    f->environment = functions->componentEnvironment;
    f->release = (functions->allocateMemory != NULL) ? functions->freeMemory : free;
    f->co_simulation = (fmuType == fmi2CoSimulation) ? 1 : 0;
    f->logging = loggingOn;
    f->name = gt_fmu_copied(instanceName, allocate);
    if (f->name == NULL) {
        if (f->release != NULL) {
            f->release(f);
        }
        return NULL;
    }
    gt_fmu_reset(f);
    return f;
}

void fmi2FreeInstance(fmi2Component c)
{
    if ((c != NULL) && (F->release != NULL)) {
        void (*release)(void *) = F->release;

        release(F->name);
        release(c);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_set_experiment(F, startTime, stopTimeDefined ? stopTime : DBL_MAX,
                                                           "SetupExperiment");
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_enter_initialization(F, F->data.v[0]);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_exit_initialization(F);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_change(F, GT_FMU_RUNNING, GT_FMU_TERMINATED, "Terminate");
}

fmi2Status fmi2Reset(fmi2Component c)
{
    if (c == NULL) {
        return fmi2Error;
    }
    gt_fmu_reset(F);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_get(F, vr, nvr, value);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_get_integers(F, vr, nvr, value);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetBoolean", nvr);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetString", nvr);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_set(F, vr, nvr, value);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_set_integers(F, vr, nvr, value);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "SetBoolean", nvr);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "SetString", nvr);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    if ((c == NULL) || (FMUstate == NULL)) {
        return null(c, "GetFMUstate");
    }
    if (*FMUstate == NULL) {
        *FMUstate = calloc(1U, sizeof(gt_fmu_data));
    }
    if (*FMUstate == NULL) {
        return (fmi2Status)gt_fmu_refuse(F, GT_FMU_ERROR, "GetFMUstate", "there is no memory");
    }
    (void)memcpy(*FMUstate, &F->data, sizeof(gt_fmu_data));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    if ((c == NULL) || (FMUstate == NULL)) {
        return null(c, "SetFMUstate");
    }
    return (fmi2Status)gt_fmu_restore(F, (const gt_fmu_data *)FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    if (c == NULL) {
        return fmi2Error;
    }
    if (FMUstate != NULL) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    if ((c == NULL) || (FMUstate == NULL) || (size == NULL)) {
        return null(c, "SerializedFMUstateSize");
    }
    *size = gt_fmu_bytes();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    if ((c == NULL) || (FMUstate == NULL) || (serializedState == NULL)) {
        return null(c, "SerializeFMUstate");
    }
    if (size != gt_fmu_bytes()) {
        return (fmi2Status)gt_fmu_refuse(F, GT_FMU_ERROR, "SerializeFMUstate", "the place has another size");
    }
    gt_fmu_pack((const gt_fmu_data *)FMUstate, (unsigned char *)serializedState);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    gt_fmu_data there;

    if ((c == NULL) || (FMUstate == NULL) || (serializedState == NULL)) {
        return null(c, "DeSerializeFMUstate");
    }
    if (gt_fmu_unpack(F, (const unsigned char *)serializedState, size, &there) != GT_FMU_OK) {
        return fmi2Error;
    }
    if (*FMUstate == NULL) {
        *FMUstate = calloc(1U, sizeof(gt_fmu_data));
    }
    if (*FMUstate == NULL) {
        return fmi2Error;
    }
    (void)memcpy(*FMUstate, &there, sizeof(there));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_slope(F, vUnknown_ref, nUnknown, vKnown_ref, nKnown, dvKnown, dvUnknown, 0);
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_change(F, (int)GT_FMU_CONTINUOUS + (int)GT_FMU_EVENT, GT_FMU_EVENT,
                                                   "EnterEventMode");
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    gt_fmu_result result;
    int defined;
    double next;

    if ((c == NULL) || (fmi2eventInfo == NULL)) {
        return null(c, "NewDiscreteStates");
    }
    result = gt_fmu_update(F, &defined, &next);
    if (result == GT_FMU_OK) {
        fmi2eventInfo->newDiscreteStatesNeeded = fmi2False;
        fmi2eventInfo->terminateSimulation = fmi2False;
        fmi2eventInfo->nominalsOfContinuousStatesChanged = fmi2False;
        fmi2eventInfo->valuesOfContinuousStatesChanged = fmi2False;
        fmi2eventInfo->nextEventTimeDefined = defined;
        fmi2eventInfo->nextEventTime = next;
    }
    return (fmi2Status)result;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_change(F, (int)GT_FMU_EVENT, GT_FMU_CONTINUOUS, "EnterContinuousTimeMode");
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    gt_fmu_result result;

    (void)noSetFMUStatePriorToCurrentPoint;
    if ((c == NULL) || (enterEventMode == NULL) || (terminateSimulation == NULL)) {
        return null(c, "CompletedIntegratorStep");
    }
    result = gt_fmu_completed(F);
    if (result == GT_FMU_OK) {
        *enterEventMode = fmi2False;
        *terminateSimulation = fmi2False;
    }
    return (fmi2Status)result;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_set_time(F, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_set_states(F, x, nx);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_get_derivatives(F, derivatives, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    (void)eventIndicators;
    return (c == NULL) ? fmi2Error : unknown(c, "GetEventIndicators", ni);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_get_states(F, x, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    return (c == NULL) ? fmi2Error : (fmi2Status)gt_fmu_get_nominals(F, x_nominal, nx);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "SetRealInputDerivatives", nvr);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetRealOutputDerivatives", nvr);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    double reached;

    (void)noSetFMUStatePriorToCurrentPoint;
    /* where it is discarded the model stays at the last good part, and fmi2GetRealStatus says when that was */
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_advance(F, currentCommunicationPoint, communicationStepSize, &reached);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return (c == NULL) ? fmi2Error
                       : (fmi2Status)gt_fmu_refuse(F, GT_FMU_ERROR, "CancelStep", "no step goes on by itself");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetStatus", 1U);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    if ((c == NULL) || (value == NULL)) {
        return null(c, "GetRealStatus");
    }
    if (s != fmi2LastSuccessfulTime) {
        return unknown(c, "GetRealStatus", 1U);
    }
    *value = F->data.reached;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetIntegerStatus", 1U);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if ((c == NULL) || (value == NULL)) {
        return null(c, "GetBooleanStatus");
    }
    if (s != fmi2Terminated) {
        return unknown(c, "GetBooleanStatus", 1U);
    }
    /* the same step would end so again and again, and there are importers that try it for ever */
    *value = (F->data.stuck != 0) ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    return (c == NULL) ? fmi2Error : unknown(c, "GetStringStatus", 1U);
}
