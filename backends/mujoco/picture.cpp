#include "backends/mujoco/picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <dlfcn.h>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#include <stb/stb_image_write.h>

#include "backends/mujoco/engine.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {
namespace {

// An OpenGL context without a screen, from libraries loaded on demand: EGL without a surface, otherwise
// OSMesa. It belongs to the thread that made it current.
class GlContext {
 public:
  virtual ~GlContext() = default;
  virtual bool make_current() = 0;
  virtual const char* name() const = 0;

  // nullptr: neither works; `reason` is set to the cause and what to install.
  static std::unique_ptr<GlContext> create(std::string& reason);
};

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
  static constexpr int kSize = 64;  // of the invisible window; pictures use a separate buffer
  unsigned char (*make_current_)(void*, void*, unsigned, int, int) = nullptr;
  void (*destroy_)(void*) = nullptr;
  void* context_ = nullptr;
  std::vector<std::uint32_t> buffer_ = std::vector<std::uint32_t>(kSize * kSize);
};

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

}  // namespace

struct Painter::Drawing {
  std::unique_ptr<GlContext> gl;
  mjData* data = nullptr;
  mjvScene scene;
  mjvOption visible;
  mjvCamera camera;
  mjrContext context;
  bool made = false;

  ~Drawing() {
    if (made && gl->make_current()) {
      mjr_freeContext(&context);
      mjv_freeScene(&scene);
    }
    mj_deleteData(data);
  }
};

Painter::Painter(const mjModel* model, PictureOptions options)
    : model_(model), options_(options), drawing_(std::make_unique<Drawing>()) {
  load_engine();
  Drawing& d = *drawing_;
  if (options_.width < 16 || options_.height < 16 || options_.width > model->vis.global.offwidth ||
      options_.height > model->vis.global.offheight) {
    reason_ = "the picture size must be 16 x 16 to " + std::to_string(model->vis.global.offwidth) + " x " +
              std::to_string(model->vis.global.offheight) + " pixels";
    return;
  }
  d.gl = GlContext::create(reason_);
  if (d.gl == nullptr) return;
  mjv_defaultScene(&d.scene);
  mjv_defaultOption(&d.visible);
  mjv_defaultCamera(&d.camera);
  mjr_defaultContext(&d.context);
  d.made = without_engine_error([this, &d] {
    d.data = mj_makeData(model_);
    mjv_makeScene(model_, &d.scene, 2000);
    mjr_makeContext(model_, &d.context, mjFONTSCALE_100);
    mjr_setBuffer(mjFB_OFFSCREEN, &d.context);
  });
  if (!d.made) {
    reason_ = std::string("no picture: ") + d.gl->name() + ": " + last_engine_error();
    return;
  }
  // Group 2: visible shapes; group 3: collision shapes.
  std::fill_n(d.visible.geomgroup, mjNGROUP, mjtByte{0});
  d.visible.geomgroup[0] = d.visible.geomgroup[1] = d.visible.geomgroup[2] = 1;
  d.visible.geomgroup[3] = options_.collision_shapes ? 1 : 0;
  std::fill_n(d.visible.sitegroup, mjNGROUP, mjtByte{0});
  d.scene.flags[mjRND_SHADOW] = 1;
  d.scene.flags[mjRND_REFLECTION] = 1;
}

Painter::~Painter() = default;

// Looks at the center of all shapes except planes, from a distance that shows all of them.
void Painter::frame_camera() {
  Drawing& d = *drawing_;
  constexpr double kRadians = std::numbers::pi / 180;
  const double azimuth = options_.azimuth_deg * kRadians, elevation = options_.elevation_deg * kRadians;
  const Vector3 forward(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                        std::sin(elevation));
  const Vector3 right = forward.cross(Vector3::UnitZ()).normalized();
  const Vector3 up = right.cross(forward);
  Matrix3 R;  // rows: right, up, forward
  R << right.transpose(), up.transpose(), forward.transpose();

  Vector3 low = Vector3::Constant(1e9), high = -low;
  const auto each_shape = [&](auto&& work) {
    for (int g = 0; g < model_->ngeom; ++g) {
      if (model_->geom_type[g] == mjGEOM_PLANE || model_->geom_group[g] > 2) continue;
      work(Vector3(R * Eigen::Map<const Vector3>(d.data->geom_xpos + 3 * g)), model_->geom_rbound[g]);
    }
  };
  each_shape([&](const Vector3& p, double r) {
    low = low.cwiseMin(p - Vector3::Constant(r));
    high = high.cwiseMax(p + Vector3::Constant(r));
  });
  if (low.x() > high.x()) low = high = Vector3::Zero();
  const Vector3 middle = 0.5 * (low + high);
  const double tan_v = std::tan(0.5 * model_->vis.global.fovy * kRadians);
  const double tan_h = tan_v * options_.width / options_.height;
  double distance = 0.3;
  each_shape([&](const Vector3& p, double r) {
    const Vector3 offset = p - middle;
    distance = std::max({distance, (std::abs(offset.x()) + r) / tan_h - offset.z(),
                         (std::abs(offset.y()) + r) / tan_v - offset.z()});
  });
  const Vector3 look_at = R.transpose() * middle;
  std::copy_n(look_at.data(), 3, d.camera.lookat);
  d.camera.type = mjCAMERA_FREE;
  d.camera.distance = 1.02 * distance;
  d.camera.azimuth = options_.azimuth_deg;
  d.camera.elevation = options_.elevation_deg;
}

std::string Painter::paint(std::span<const double> qpos, const std::filesystem::path& png) {
  if (!works()) return reason_;
  if (static_cast<mjtSize>(qpos.size()) != model_->nq) {
    return "the scene has " + std::to_string(model_->nq) + "  positions, found " +
           std::to_string(qpos.size());
  }
  Drawing& d = *drawing_;
  if (!d.gl->make_current()) return std::string(d.gl->name()) + " cannot use its context";
  pixels_.assign(3 * static_cast<std::size_t>(options_.width) * static_cast<std::size_t>(options_.height), 0);
  std::copy(qpos.begin(), qpos.end(), d.data->qpos);
  const bool drawn = without_engine_error([this, &d] {
    mj_forward(model_, d.data);
    frame_camera();
    // The headlight is placed before the camera: without this it would keep the position of the last picture.
    mjv_updateCamera(model_, d.data, &d.camera, &d.scene);
    mjv_updateScene(model_, d.data, &d.visible, nullptr, &d.camera, mjCAT_ALL, &d.scene);
    const mjrRect all{0, 0, options_.width, options_.height};
    mjr_render(all, &d.scene, &d.context);
    mjr_readPixels(pixels_.data(), nullptr, all, &d.context);
  });
  if (!drawn) return last_engine_error();
  stbi_flip_vertically_on_write(1);
  if (stbi_write_png(png.c_str(), options_.width, options_.height, 3, pixels_.data(), 3 * options_.width) ==
      0) {
    return "cannot write " + png.string();
  }
  return {};
}

}  // namespace multipanda
