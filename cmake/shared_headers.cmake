# multipanda_shared_headers(OUT ROOT [CONFIGURE_DEPENDS]): the headers that a user's library can include, relative to ROOT.
function(multipanda_shared_headers out root)
  file(GLOB_RECURSE found RELATIVE "${root}" ${ARGN} "${root}/core/*.hpp" "${root}/ros/adapter/controllets/input_codec.hpp")
  # Test support, and what only core's own source files include.
  list(FILTER found EXCLUDE REGEX "/testing/|/guard/|/pinocchio_[^/]*$|^core/plugin/(load_plugin|c_law_controllets|law_trial).hpp$")
  list(SORT found)
  set(${out} "${found}" PARENT_SCOPE)
endfunction()
