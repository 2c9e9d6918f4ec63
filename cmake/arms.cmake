# The libraries of a program for arms alone: Pinocchio's and Boost's headers, urdfdom (wheels of .venv, or of the other
# processor beside its sysroot).
set(MULTIPANDA_MUJOCO "none")
set(headers "${MULTIPANDA_SITE_PACKAGES}/cmeel.prefix/include")
foreach(target pinocchio::pinocchio_headers Boost::headers)
  add_library(${target} INTERFACE IMPORTED)
  target_include_directories(${target} INTERFACE ${headers})
endforeach()
set(CMAKE_BUILD_RPATH "${MULTIPANDA_SITE_PACKAGES}/cmeel.prefix/lib")
if(CMAKE_CROSSCOMPILING)
  set(CMAKE_BUILD_RPATH "${CMAKE_SYSROOT}/cmeel.prefix/lib")
endif()
foreach(library urdfdom_model tinyxml2 console_bridge)
  add_library(urdfdom::${library} SHARED IMPORTED)
  file(GLOB file "${CMAKE_BUILD_RPATH}/lib${library}.so")
  set_target_properties(urdfdom::${library} PROPERTIES IMPORTED_LOCATION "${file}"
                        INTERFACE_INCLUDE_DIRECTORIES "${headers}/urdfdom;${headers}/urdfdom_headers;${headers}")
endforeach()
target_link_libraries(urdfdom::urdfdom_model INTERFACE urdfdom::tinyxml2 urdfdom::console_bridge)
# What no command of the program reaches is left out, and of functions with the same code all but one: 5 % (lld).
add_compile_options(-ffunction-sections -fdata-sections)
add_link_options(-fuse-ld=lld -Wl,--gc-sections -Wl,--icf=safe -Wl,-s)
