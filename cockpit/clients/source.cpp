#include "cockpit/clients/source.hpp"

#include <array>
#include <bit>

namespace multipanda::cockpit {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are sent unchanged");

std::string frame(const std::array<std::uint32_t, 4>& head, std::string_view bytes) {
  std::string out(reinterpret_cast<const char*>(head.data()), sizeof(head));
  return out.append(bytes);
}

}  // namespace

std::string state_frame(std::uint32_t number, std::span<const double> values) {
  return frame({kState, number, static_cast<std::uint32_t>(values.size()), 0},
               {reinterpret_cast<const char*>(values.data()), values.size_bytes()});
}

std::string rows_frame(std::uint32_t kind, std::uint32_t number, std::uint32_t rows, std::uint32_t columns,
                       std::string_view bytes) {
  return frame({kind, number, rows, columns}, bytes);
}

}  // namespace multipanda::cockpit
