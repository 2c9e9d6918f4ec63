#pragma once

#include <string>
#include <vector>

#include "study/study.hpp"

// What the choices of a study lead to, found out before the first run.
namespace multipanda {

// Tries each choice with the first ones of the other axes. Throws ConfigError: the axis, the choice, and what
// is wrong with it.
void check_choices(const Study& study);

// All files on the disk that decide about a run, besides the program: scene, models, plug-ins, experiments,
// of all choices. Sorted.
std::vector<std::string> study_files(const Study& study);

}  // namespace multipanda
