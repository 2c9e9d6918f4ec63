// Small series for series_test.py, among them some that fail. Not a test of its own.
#include <cstdlib>
#include <iostream>

#include "core/testing/series.hpp"

namespace multipanda::test {
namespace {

TEST(Sample, Passes) {
  Series series;
  for (int k = 0; k < 30; ++k) {
    if (!series.takes(k % 10 == 0)) continue;
    series.record("number", k);
    series.record("third", k / 3.0);
  }
  if (!series.whole()) return;
  std::cout << series.size() << " cases, the sum is " << series.sum("number") << "\n";
  EXPECT_EQ(series.largest("third"), series.largest("number") / 3);
}

TEST(Sample, OneCaseFails) {
  Series series;
  for (int k = 0; k < 30; ++k) {
    if (!series.takes(k % 10 == 0)) continue;
    EXPECT_NE(k, 17) << "seventeen";
  }
}

TEST(Sample, TogetherTheyFail) {
  Series series;
  for (int k = 0; k < 3; ++k) {
    if (series.takes(true)) series.record("one", 1);
  }
  if (series.whole()) {
    EXPECT_LT(series.sum("one"), 3);
  }
}

TEST(Sample, OneCaseDies) {
  Series series;
  for (int k = 0; k < 5; ++k) {
    if (series.takes(true) && k == 3) std::abort();
  }
}

TEST(Sample, IsNoSeries) {}

}  // namespace
}  // namespace multipanda::test
