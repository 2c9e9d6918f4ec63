#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <mujoco/mjbatch.h>
#include <mujoco/mujoco.h>

// MuJoCo's functions by their own names, in a library of their own (engine_module.cpp) that is loaded with
// the first simulation. A run without one has no engine in its process. Add every
// further function that is called to this list.
namespace multipanda {

// clang-format off
#define MULTIPANDA_ENGINE(F) \
  F(mju_user_error) F(mju_user_warning) F(mju_rayGeom) \
  F(mj_makeSpec) F(mj_parseXMLString) F(mj_compile) F(mj_deleteSpec) F(mj_copyModel) F(mj_deleteModel) \
  F(mj_makeData) F(mj_resetData) F(mj_deleteData) F(mj_setConst) \
  F(mj_step) F(mj_forward) F(mj_kinematics) F(mj_fullM) F(mj_contactForce) F(mj_rnePostConstraint) F(mj_geomDistance) F(mj_jacSite) \
  F(mj_objectVelocity) F(mj_isSparse) F(mj_name2id) F(mj_id2name) \
  F(mjs_addBody) F(mjs_addEquality) F(mjs_addExclude) F(mjs_addFrame) F(mjs_addFreeJoint) F(mjs_addGeom) F(mjs_addLight) \
  F(mjs_addMaterial) F(mjs_addPair) F(mjs_addTexture) F(mjs_asGeom) F(mjs_asSite) F(mjs_attach) F(mjs_findBody) \
  F(mjs_findElement) F(mjs_firstChild) F(mjs_nextChild) F(mjs_getError) F(mjs_setDeepCopy) F(mjs_setInStringVec) \
  F(mjs_setName) F(mjs_setString) \
  F(mjv_defaultCamera) F(mjv_defaultOption) F(mjv_defaultScene) F(mjv_freeScene) F(mjv_makeScene) F(mjv_updateCamera) \
  F(mjv_updateScene) \
  F(mjr_defaultContext) F(mjr_freeContext) F(mjr_makeContext) F(mjr_readPixels) F(mjr_render) F(mjr_setBuffer) \
  F(mjb_apply) F(mjb_defaultConfig) F(mjb_deleteBatch) F(mjb_error) F(mjb_makeBatch) F(mjb_setModels) \
  F(mj_sizeModel) F(mj_saveModel)
// clang-format on

#define MULTIPANDA_DECLARE(name) extern decltype(&::name) name;
MULTIPANDA_ENGINE(MULTIPANDA_DECLARE)
#undef MULTIPANDA_DECLARE

struct Engine {
#define MULTIPANDA_MEMBER(function) decltype(&::function) function;
  MULTIPANDA_ENGINE(MULTIPANDA_MEMBER)
#undef MULTIPANDA_MEMBER
};

// MuJoCo reports errors through a process-wide handler that must not return, and warnings through one that by
// default writes a file. These handlers neither end the process nor write a file.

// Calls `work`; true if MuJoCo reported no error. After an error, last_engine_error() of this thread has the
// text. The call was aborted at the error: do not use its data any more. `work` must not own
// anything with a destructor on its stack.
bool without_engine_error(void (*work)(void*), void* argument);

// The same for any callable, without allocating.
template <typename Work>
bool without_engine_error(Work&& work) {
  return without_engine_error(
      [](void* argument) { (*static_cast<std::remove_reference_t<Work>*>(argument))(); }, &work);
}

const char* last_engine_error();

// Must be called before any use of MuJoCo, off the loop: loads it (engine.hpp) and sets these handlers.
// Throws std::runtime_error if there is no library.
void load_engine();

}  // namespace multipanda
