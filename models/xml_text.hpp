#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/types/spatial.hpp"

namespace multipanda {

// The shortest text that reads back as the same double, independent of the locale.
std::string exact(double value);
std::string exact(const Vector3& v);     // separated by blanks
std::string exact(const Quaternion& q);  // w x y z

// Writes XML: indented, escaped, elements closed in order.
class XmlText {
 public:
  using Attributes = std::vector<std::pair<std::string_view, std::string>>;

  void open(std::string_view element, const Attributes& attributes = {});
  void close();
  void leaf(std::string_view element, const Attributes& attributes = {});
  void comment(const std::string& text);
  const std::string& text() const { return text_; }

 private:
  void begin(std::string_view element, const Attributes& attributes);

  std::string text_;
  std::vector<std::string> open_;
};

}  // namespace multipanda
