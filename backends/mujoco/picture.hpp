#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "backends/mujoco/engine.hpp"

namespace multipanda {

struct PictureOptions {
  int width = 1000, height = 700;  // [pixel], at most 1920 x 1440
  bool collision_shapes = false;   // show the collision shapes
  double azimuth_deg = 140;        // the camera's view direction about z; 90 looks along +y
  double elevation_deg = -22;      // below 0: from above
};

// Draws pictures of a MuJoCo model without a screen; the camera frames the whole scene. It belongs to the
// thread that created it. The model must outlive it.
class Painter {
 public:
  explicit Painter(const mjModel* model, PictureOptions options = {});
  ~Painter();
  Painter(const Painter&) = delete;
  Painter& operator=(const Painter&) = delete;

  // Whether pictures can be made; if not, the reason and what to install.
  bool works() const { return reason_.empty(); }
  const std::string& reason() const { return reason_; }

  // The model at joint positions qpos (nq). Returns the reason of a failure, or an empty string.
  std::string paint(std::span<const double> qpos, const std::filesystem::path& png);

  // Pixels of the last picture: red, green, blue; rows from the bottom.
  const std::vector<std::uint8_t>& pixels() const { return pixels_; }

 private:
  struct Drawing;
  void frame_camera();

  const mjModel* model_;
  PictureOptions options_;
  std::string reason_;
  std::unique_ptr<Drawing> drawing_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace multipanda
