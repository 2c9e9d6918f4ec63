#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "models/from_urdf.hpp"

namespace multipanda {

// Gives an imported arm capsules around the <collision> geometry of its moving links, at most kMostCapsules
// per link of the arm, each containing what it is fitted to, and its base convex hulls, at most
// kMostBaseHulls for all that is fixed to it. Two arms of one robot have equal ones, which count once
// (core/features/collision_pairs.hpp). Pairs of links, or of a hull and a link, that overlap at home, or in
// more than kOften of random configurations, are ignored: the shapes are wider than the bodies there. A hull
// and a link that are nearer than kClearAtHome at home count as overlapping: collision_avoidance could not be
// switched on there.
// robot.origin["self_collision"] says what was found, how much wider the capsules are, and which pairs are
// ignored, as does robot.unguarded_pairs. Meshes are looked up as
// urdf_file does, from `folder`. Throws std::invalid_argument if a shape cannot be read, because an arm with
// gaps would seem to be protected.
inline constexpr std::size_t kMostCapsules = 3, kMostBaseHulls = 6;
inline constexpr double kOften = 0.3;
inline constexpr double kClearAtHome = 0.02;  // [m]
void fit_collision(const std::string& urdf_text, const UrdfChain& chain, const std::filesystem::path& folder,
                   RobotDescription& robot);

// The meshes of all <collision> geometry of a URDF that exist.
std::vector<std::filesystem::path> mesh_files(const std::filesystem::path& urdf);

}  // namespace multipanda
