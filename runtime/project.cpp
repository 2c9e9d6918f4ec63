#include "runtime/project.hpp"

#include <cstdlib>

namespace multipanda {

std::filesystem::path project_root() {
  const char* share = std::getenv("MULTIPANDA_SHARE");
  return share != nullptr && *share != '\0' ? share : MULTIPANDA_ROOT;
}

}  // namespace multipanda
