#include "models/xml_text.hpp"

#include <stdexcept>

#include "common/text.hpp"

namespace multipanda {
namespace {

std::string escaped(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      default:
        safe += c;
    }
  }
  return safe;
}

}  // namespace

std::string exact(double value) {
  return number_text(value == 0 ? 0.0 : value);  // no "-0"
}

std::string exact(const Vector3& v) { return exact(v.x()) + " " + exact(v.y()) + " " + exact(v.z()); }

std::string exact(const Quaternion& q) {
  return exact(q.w()) + " " + exact(q.x()) + " " + exact(q.y()) + " " + exact(q.z());
}

void XmlText::begin(std::string_view element, const Attributes& attributes) {
  text_.append(2 * open_.size(), ' ').append("<").append(element);
  for (const auto& [key, value] : attributes)
    text_.append(" ").append(key).append("=\"").append(escaped(value)).append("\"");
}

void XmlText::open(std::string_view element, const Attributes& attributes) {
  begin(element, attributes);
  text_ += ">\n";
  open_.emplace_back(element);
}

void XmlText::close() {
  if (open_.empty()) throw std::logic_error("XmlText: more elements closed than opened");
  const std::string element = open_.back();
  open_.pop_back();
  text_.append(2 * open_.size(), ' ').append("</").append(element).append(">\n");
}

void XmlText::leaf(std::string_view element, const Attributes& attributes) {
  begin(element, attributes);
  text_ += "/>\n";
}

void XmlText::comment(const std::string& text) {
  std::string safe = text;  // "--" is not allowed in a comment
  for (auto at = safe.find("--"); at != std::string::npos; at = safe.find("--", at))
    safe.replace(at, 2, "- -");
  text_.append(2 * open_.size(), ' ').append("<!-- ").append(safe).append(" -->\n");
}

}  // namespace multipanda
