#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>

namespace multipanda {

struct PictureOptions {
  int width = 1000, height = 700;  // [pixel], at most 1920 x 1440
  bool collision_shapes = false;   // show the capsules that touch
  double azimuth_deg = 140;        // the camera's view direction about z; 90 looks along +y
  double elevation_deg = -22;      // below 0: from above
};

// Draws pictures of a MuJoCo model without a screen; the camera frames all that is there. Belongs to the
// thread that made it. The model must live as long.
class Painter {
 public:
  explicit Painter(const mjModel* model, PictureOptions options = {});
  ~Painter();
  Painter(const Painter&) = delete;
  Painter& operator=(const Painter&) = delete;

  // Whether pictures can be made here; if not, why and what to install.
  bool works() const { return reason_.empty(); }
  const std::string& reason() const { return reason_; }

  // The model at joint positions qpos (nq). Empty on success, else the reason.
  std::string paint(std::span<const double> qpos, const std::filesystem::path& png);

  // Of the last picture: red, green, blue per pixel, rows from the bottom.
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
