#include "backends/mujoco/gl_context.hpp"

#include <array>
#include <cstdint>
#include <cstdlib>
#include <dlfcn.h>
#include <vector>

namespace multipanda {
namespace {

template <typename Function>
bool load(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  return function != nullptr;
}

// The EGL names that are needed (Khronos EGL 1.5, EGL_MESA_platform_surfaceless), so that no header
// has to be installed.
class EglContext : public GlContext {
 public:
  ~EglContext() override {
    if (context_ != nullptr) {
      make_current_(display_, nullptr, nullptr, nullptr);
      destroy_context_(display_, context_);
    }
  }
  bool make_current() override { return make_current_(display_, nullptr, nullptr, context_) != 0; }
  const char* name() const override { return "EGL"; }

  bool open(std::string& reason) {
    void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) return fail(reason, "libEGL.so.1 is not installed");
    void* (*get_proc_address)(const char*) = nullptr;
    int (*initialize)(void*, int*, int*) = nullptr;
    int (*bind_api)(unsigned) = nullptr;
    int (*choose_config)(void*, const int*, void**, int, int*) = nullptr;
    void* (*create_context)(void*, void*, void*, const int*) = nullptr;
    if (!load(library, "eglGetProcAddress", get_proc_address) ||
        !load(library, "eglInitialize", initialize) || !load(library, "eglBindAPI", bind_api) ||
        !load(library, "eglChooseConfig", choose_config) ||
        !load(library, "eglCreateContext", create_context) ||
        !load(library, "eglMakeCurrent", make_current_) ||
        !load(library, "eglDestroyContext", destroy_context_)) {
      return fail(reason, "libEGL.so.1 lacks a function");
    }
    const auto get_display = reinterpret_cast<void* (*)(unsigned, void*, const int*)>(
        get_proc_address("eglGetPlatformDisplayEXT"));
    if (get_display == nullptr) return fail(reason, "EGL has no platform displays");
    constexpr unsigned kSurfacelessMesa = 0x31DD, kOpenGlApi = 0x30A2;
    display_ = get_display(kSurfacelessMesa, nullptr, nullptr);
    int major = 0, minor = 0;
    if (display_ == nullptr || initialize(display_, &major, &minor) == 0) {
      return fail(reason, "EGL has no display without a surface");
    }
    constexpr int kRenderableType = 0x3040, kOpenGlBit = 0x0008, kNone = 0x3038;
    constexpr std::array requested{kRenderableType, kOpenGlBit, kNone};
    void* config = nullptr;
    int count = 0;
    if (bind_api(kOpenGlApi) == 0 || choose_config(display_, requested.data(), &config, 1, &count) == 0 ||
        count == 0) {
      return fail(reason, "EGL offers no OpenGL");
    }
    context_ = create_context(display_, config, nullptr, nullptr);
    if (context_ == nullptr || !make_current()) return fail(reason, "EGL cannot create an OpenGL context");
    // MuJoCo looks up OpenGL's functions among the global symbols.
    dlopen("libEGL.so.1", RTLD_NOW | RTLD_GLOBAL);
    return true;
  }

 private:
  static bool fail(std::string& reason, const char* why) {
    reason = why;
    return false;
  }
  int (*make_current_)(void*, void*, void*, void*) = nullptr;
  int (*destroy_context_)(void*, void*) = nullptr;
  void* display_ = nullptr;
  void* context_ = nullptr;
};

class OsmesaContext : public GlContext {
 public:
  ~OsmesaContext() override {
    if (context_ != nullptr) destroy_(context_);
  }
  bool make_current() override {
    constexpr unsigned kUnsignedByte = 0x1401;
    return make_current_(context_, buffer_.data(), kUnsignedByte, kSize, kSize) != 0;
  }
  const char* name() const override { return "OSMesa"; }

  bool open(std::string& reason) {
    void* library = nullptr;
    for (const char* file : {"libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"}) {
      if (library == nullptr) library = dlopen(file, RTLD_NOW | RTLD_GLOBAL);
    }
    if (library == nullptr) {
      reason = "libOSMesa is not installed";
      return false;
    }
    void* (*create_context)(unsigned, int, int, int, void*) = nullptr;
    if (!load(library, "OSMesaCreateContextExt", create_context) ||
        !load(library, "OSMesaMakeCurrent", make_current_) ||
        !load(library, "OSMesaDestroyContext", destroy_)) {
      reason = "libOSMesa lacks a function";
      return false;
    }
    constexpr unsigned kRgba = 0x1908;
    context_ = create_context(kRgba, 24, 8, 8, nullptr);
    if (context_ == nullptr || !make_current()) {
      reason = "OSMesa cannot create an OpenGL context";
      return false;
    }
    return true;
  }

 private:
  static constexpr int kSize = 64;  // of the invisible window; pictures use a buffer of their own
  unsigned char (*make_current_)(void*, void*, unsigned, int, int) = nullptr;
  void (*destroy_)(void*) = nullptr;
  void* context_ = nullptr;
  std::vector<std::uint32_t> buffer_ = std::vector<std::uint32_t>(kSize * kSize);
};

}  // namespace

std::unique_ptr<GlContext> GlContext::create(std::string& reason) {
  std::string why_not_egl, why_not_osmesa;
  // MULTIPANDA_GL=osmesa skips EGL, for machines whose EGL is broken.
  const char* choice = std::getenv("MULTIPANDA_GL");
  if (choice == nullptr || std::string(choice) != "osmesa") {
    auto egl = std::make_unique<EglContext>();
    if (egl->open(why_not_egl)) return egl;
  } else {
    why_not_egl = "switched off by MULTIPANDA_GL";
  }
  auto osmesa = std::make_unique<OsmesaContext>();
  if (osmesa->open(why_not_osmesa)) return osmesa;
  reason = "cannot draw pictures: EGL: " + why_not_egl + "; OSMesa: " + why_not_osmesa +
           ". Install libegl1 and libegl-mesa0, or libosmesa6";
  return nullptr;
}

}  // namespace multipanda
