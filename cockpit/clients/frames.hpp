#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace multipanda::cockpit {

// Binary messages (cockpit/WIRE.md): four u32, then f64; little-endian.
inline constexpr std::uint32_t kState = 1, kPlotRows = 2, kLogRows = 3;  // kinds

std::string state_frame(std::uint32_t number, std::span<const double> values);
// `rows`: the bytes of rows x columns f64.
std::string rows_frame(std::uint32_t kind, std::uint32_t number, std::uint32_t rows, std::uint32_t columns,
                       std::string_view bytes);

}  // namespace multipanda::cockpit
