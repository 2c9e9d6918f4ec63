// The library libmultipanda_mujoco.so: the addresses of MuJoCo's functions.
#include "backends/mujoco/engine.hpp"

extern "C" [[gnu::visibility("default")]] const multipanda::Engine multipanda_engine{
#define MULTIPANDA_ADDRESS(name) &::name,
    MULTIPANDA_ENGINE(MULTIPANDA_ADDRESS)
#undef MULTIPANDA_ADDRESS
};
