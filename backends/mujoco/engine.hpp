#pragma once

#include <mujoco/mjbatch.h>
#include <mujoco/mujoco.h>

// MuJoCo's functions by their own names, in a library of their own (engine_module.cpp) that is loaded with
// the first simulation. A run without one has no engine in its process. Another function that is called
// goes into this list.
namespace multipanda {

// clang-format off
#define MULTIPANDA_ENGINE(F) \
  F(mju_user_error) F(mju_user_warning) F(mju_rayGeom) \
  F(mj_makeSpec) F(mj_parseXMLString) F(mj_compile) F(mj_deleteSpec) F(mj_copyModel) F(mj_deleteModel) \
  F(mj_makeData) F(mj_resetData) F(mj_deleteData) F(mj_setConst) \
  F(mj_step) F(mj_forward) F(mj_kinematics) F(mj_fullM) F(mj_contactForce) F(mj_geomDistance) F(mj_jacSite) \
  F(mj_objectVelocity) F(mj_isSparse) F(mj_name2id) F(mj_id2name) \
  F(mjs_addBody) F(mjs_addEquality) F(mjs_addExclude) F(mjs_addFrame) F(mjs_addFreeJoint) F(mjs_addGeom) F(mjs_addLight) \
  F(mjs_addMaterial) F(mjs_addPair) F(mjs_addTexture) F(mjs_asGeom) F(mjs_asSite) F(mjs_attach) F(mjs_findBody) \
  F(mjs_findElement) F(mjs_firstChild) F(mjs_nextChild) F(mjs_getError) F(mjs_setDeepCopy) F(mjs_setInStringVec) \
  F(mjs_setName) F(mjs_setString) \
  F(mjv_defaultCamera) F(mjv_defaultOption) F(mjv_defaultScene) F(mjv_freeScene) F(mjv_makeScene) F(mjv_updateCamera) \
  F(mjv_updateScene) \
  F(mjr_defaultContext) F(mjr_freeContext) F(mjr_makeContext) F(mjr_readPixels) F(mjr_render) F(mjr_setBuffer) \
  F(mjb_apply) F(mjb_defaultConfig) F(mjb_deleteBatch) F(mjb_error) F(mjb_makeBatch) F(mjb_setModels)
// clang-format on

#define MULTIPANDA_DECLARE(name) extern decltype(&::name) name;
MULTIPANDA_ENGINE(MULTIPANDA_DECLARE)
#undef MULTIPANDA_DECLARE

struct Engine {
#define MULTIPANDA_MEMBER(function) decltype(&::function) function;
  MULTIPANDA_ENGINE(MULTIPANDA_MEMBER)
#undef MULTIPANDA_MEMBER
};

}  // namespace multipanda
