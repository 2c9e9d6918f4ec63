#pragma once

namespace multipanda {

// A visitor of a variant made of lambdas: std::visit(Overloaded{[](A) {...}, [](B) {...}}, variant).
template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

}  // namespace multipanda
