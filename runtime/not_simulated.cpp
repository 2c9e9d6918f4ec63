#include <stdexcept>

#include "runtime/simulated.hpp"

namespace multipanda {

bool has_simulators() { return false; }

std::unique_ptr<Backend> make_simulated(const Scene&, const BackendOptions&, const BackendPace&) {
  throw std::invalid_argument(
      "this program is for arms alone and simulates none: name the arms by --address ARM=ADDRESS or the "
      "scene's key 'fci', or use --backend fci; the package multipanda has simulators");
}

}  // namespace multipanda
