/* The functions of FMI 3.0 on gt_fmu.h; those of interfaces and types that no model here has are in gt_fmu3_none.c. */
#include "gt_fmu3.h"

#include <stdlib.h>
#include <string.h>

#define F ((gt_fmu *)instance)

static void say(const gt_fmu *f, gt_fmu_result result, const char *sentence)
{
    fmi3LogMessageCallback log;

    if (gt_fmu_is_said(f, result) == 0) {
        return;
    }
    log = (fmi3LogMessageCallback)f->logger;
    log(f->environment, (fmi3Status)result, (result == GT_FMU_DISCARD) ? "logStatusDiscard" : "logStatusError",
        sentence);
}

/* Where a pointer is NULL, or two arrays that belong together differ in length. */
static fmi3Status misfit(fmi3Instance instance, const char *call)
{
    return (instance == NULL) ? fmi3Error
                              : (fmi3Status)gt_fmu_refuse(F, GT_FMU_ERROR, call,
                                                          "a pointer is NULL, or arrays differ in length");
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_log(F, loggingOn ? 1 : 0, nCategories, categories);
}

/* A new instance, or NULL where the token is that of another model. */
static gt_fmu *made(fmi3String name, fmi3String token, bool logging, void *environment, fmi3LogMessageCallback log,
                    int co_simulation)
{
    gt_fmu *f;

    if ((name == NULL) || (token == NULL) || (strcmp(token, GT_FMU_TOKEN) != 0)) {
        if (log != NULL) {
            log(environment, fmi3Error, "logStatusError", "Instantiate: the token is that of another model");
        }
        return NULL;
    }
    f = (gt_fmu *)calloc(1U, sizeof(gt_fmu));
    if (f == NULL) {
        return NULL;
    }
    f->say = say;
    f->logger = (void (*)(void))log;
    f->environment = environment;
    f->co_simulation = co_simulation;
    f->logging = logging ? 1 : 0;
    gt_fmu_reset(f);
    return f;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)resourcePath;
    (void)visible;
    return made(instanceName, instantiationToken, loggingOn, instanceEnvironment, logMessage, 0);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)resourcePath;
    (void)visible;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)intermediateUpdate;
    if (eventModeUsed || (nRequiredIntermediateVariables > 0U)) {
        if (logMessage != NULL) {
            logMessage(instanceEnvironment, fmi3Error, "logStatusError",
                       "Instantiate: this model has neither an event mode nor intermediate values");
        }
        return NULL;
    }
    return made(instanceName, instantiationToken, loggingOn, instanceEnvironment, logMessage, 1);
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    if ((instance == NULL) || (gt_fmu_set_experiment(F, startTime, stopTimeDefined ? stopTime : DBL_MAX,
                                                     "EnterInitializationMode") != GT_FMU_OK)) {
        return fmi3Error;
    }
    return (fmi3Status)gt_fmu_enter_initialization(F, startTime);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_exit_initialization(F);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return (instance == NULL) ? fmi3Error
                              : (fmi3Status)gt_fmu_change(F, (int)GT_FMU_CONTINUOUS, GT_FMU_EVENT, "EnterEventMode");
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return (instance == NULL) ? fmi3Error
                              : (fmi3Status)gt_fmu_change(F, GT_FMU_RUNNING, GT_FMU_TERMINATED, "Terminate");
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    if (instance == NULL) {
        return fmi3Error;
    }
    gt_fmu_reset(F);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues)
{
    if ((instance == NULL) || (nValues != nValueReferences)) {
        return misfit(instance, "GetFloat64");
    }
    return (fmi3Status)gt_fmu_get(F, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues)
{
    if ((instance == NULL) || (nValues != nValueReferences)) {
        return misfit(instance, "SetFloat64");
    }
    return (fmi3Status)gt_fmu_set(F, valueReferences, nValueReferences, values);
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Int32 values[], size_t nValues)
{
    if ((instance == NULL) || (nValues != nValueReferences)) {
        return misfit(instance, "GetInt32");
    }
    return (fmi3Status)gt_fmu_get_integers(F, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Int32 values[], size_t nValues)
{
    if ((instance == NULL) || (nValues != nValueReferences)) {
        return misfit(instance, "SetInt32");
    }
    return (fmi3Status)gt_fmu_set_integers(F, valueReferences, nValueReferences, values);
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if ((instance == NULL) || (FMUState == NULL)) {
        return misfit(instance, "GetFMUState");
    }
    if (*FMUState == NULL) {
        *FMUState = calloc(1U, sizeof(gt_fmu_data));
    }
    if (*FMUState == NULL) {
        return (fmi3Status)gt_fmu_refuse(F, GT_FMU_ERROR, "GetFMUState", "there is no memory");
    }
    (void)memcpy(*FMUState, &F->data, sizeof(gt_fmu_data));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    if ((instance == NULL) || (FMUState == NULL)) {
        return misfit(instance, "SetFMUState");
    }
    return (fmi3Status)gt_fmu_restore(F, (const gt_fmu_data *)FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if (instance == NULL) {
        return fmi3Error;
    }
    if (FMUState != NULL) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    if ((instance == NULL) || (FMUState == NULL) || (size == NULL)) {
        return misfit(instance, "SerializedFMUStateSize");
    }
    *size = gt_fmu_bytes();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    if ((instance == NULL) || (FMUState == NULL) || (serializedState == NULL)) {
        return misfit(instance, "SerializeFMUState");
    }
    if (size != gt_fmu_bytes()) {
        return (fmi3Status)gt_fmu_refuse(F, GT_FMU_ERROR, "SerializeFMUState", "the place has another size");
    }
    gt_fmu_pack((const gt_fmu_data *)FMUState, serializedState);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState)
{
    gt_fmu_data there;

    if ((instance == NULL) || (FMUState == NULL) || (serializedState == NULL)) {
        return misfit(instance, "DeserializeFMUState");
    }
    if (gt_fmu_unpack(F, serializedState, size, &there) != GT_FMU_OK) {
        return fmi3Error;
    }
    if (*FMUState == NULL) {
        *FMUState = calloc(1U, sizeof(gt_fmu_data));
    }
    if (*FMUState == NULL) {
        return fmi3Error;
    }
    (void)memcpy(*FMUState, &there, sizeof(there));
    return fmi3OK;
}

/* Of a derivative along or against a seed. */
static fmi3Status slope(fmi3Instance instance, const fmi3ValueReference *unknowns, size_t nUnknowns,
                        const fmi3ValueReference *knowns, size_t nKnowns, const double *seed, size_t nSeed,
                        double *sensitivity, size_t nSensitivity, int adjoint)
{
    if ((instance == NULL) || (nSeed != ((adjoint != 0) ? nUnknowns : nKnowns)) ||
        (nSensitivity != ((adjoint != 0) ? nKnowns : nUnknowns))) {
        return misfit(instance, "GetDirectionalDerivative");
    }
    return (fmi3Status)gt_fmu_slope(F, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity, adjoint);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    return slope(instance, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity, 0);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    return slope(instance, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity, 1);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    gt_fmu_result result;
    int defined;
    double next;

    if ((instance == NULL) || (discreteStatesNeedUpdate == NULL) || (terminateSimulation == NULL) ||
        (nominalsOfContinuousStatesChanged == NULL) || (valuesOfContinuousStatesChanged == NULL) ||
        (nextEventTimeDefined == NULL) || (nextEventTime == NULL)) {
        return misfit(instance, "UpdateDiscreteStates");
    }
    result = gt_fmu_update(F, &defined, &next);
    if (result == GT_FMU_OK) {
        *discreteStatesNeedUpdate = false;
        *terminateSimulation = false;
        *nominalsOfContinuousStatesChanged = false;
        *valuesOfContinuousStatesChanged = false;
        *nextEventTimeDefined = (defined != 0);
        *nextEventTime = next;
    }
    return (fmi3Status)result;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_in(F, (int)GT_FMU_EVENT, "EvaluateDiscreteStates");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return (instance == NULL) ? fmi3Error
                              : (fmi3Status)gt_fmu_change(F, (int)GT_FMU_EVENT, GT_FMU_CONTINUOUS,
                                                          "EnterContinuousTimeMode");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    gt_fmu_result result;

    (void)noSetFMUStatePriorToCurrentPoint;
    if ((instance == NULL) || (enterEventMode == NULL) || (terminateSimulation == NULL)) {
        return misfit(instance, "CompletedIntegratorStep");
    }
    result = gt_fmu_completed(F);
    if (result == GT_FMU_OK) {
        *enterEventMode = false;
        *terminateSimulation = false;
    }
    return (fmi3Status)result;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_set_time(F, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_set_states(F, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_get_derivatives(F, derivatives, nContinuousStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    (void)eventIndicators;
    return ((instance == NULL) || (nEventIndicators > 0U)) ? misfit(instance, "GetEventIndicators") : fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_get_states(F, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates)
{
    return (instance == NULL) ? fmi3Error : (fmi3Status)gt_fmu_get_nominals(F, nominals, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    if ((instance == NULL) || (nEventIndicators == NULL)) {
        return misfit(instance, "GetNumberOfEventIndicators");
    }
    *nEventIndicators = 0U;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    if ((instance == NULL) || (nContinuousStates == NULL)) {
        return misfit(instance, "GetNumberOfContinuousStates");
    }
    *nContinuousStates = (size_t)GT_FMU_STATES;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    gt_fmu_data before;
    gt_fmu_result result;
    double reached;

    (void)noSetFMUStatePriorToCurrentPoint;
    if ((instance == NULL) || (eventHandlingNeeded == NULL) || (terminateSimulation == NULL) ||
        (earlyReturn == NULL) || (lastSuccessfulTime == NULL)) {
        return misfit(instance, "DoStep");
    }
    (void)memcpy(&before, &F->data, sizeof(before));
    result = gt_fmu_advance(F, currentCommunicationPoint, communicationStepSize, &reached);
    if (result != GT_FMU_ERROR) {
        *eventHandlingNeeded = false;
        *terminateSimulation = false;
        *earlyReturn = false;
        *lastSuccessfulTime = reached;
    }
    if (result == GT_FMU_DISCARD) {
        /* the standard's word: the state is as before the call; a step up to lastSuccessfulTime goes well */
        (void)memcpy(&F->data, &before, sizeof(before));
    }
    return (fmi3Status)result;
}
