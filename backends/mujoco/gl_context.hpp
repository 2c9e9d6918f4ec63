#pragma once

#include <memory>
#include <string>

namespace multipanda {

// An OpenGL context without a screen, from libraries that are loaded on demand: EGL without a surface,
// otherwise OSMesa. It belongs to the thread that made it current.
class GlContext {
 public:
  virtual ~GlContext() = default;
  virtual bool make_current() = 0;
  virtual const char* name() const = 0;

  // nullptr: neither works; `reason` gets the cause and what to install.
  static std::unique_ptr<GlContext> create(std::string& reason);
};

}  // namespace multipanda
