# ROS 2 comes from a ROS 2 installation sourced in this shell, otherwise from the wheels in .venv (requirements-ros.txt).
# -DMULTIPANDA_ROS=OFF omits it. Functions for the folders below ros/:
#   multipanda_ros_library(NAME SOURCES ... DEPS ... [PRIVATE_DEPS ...])  static library that may use rcl and messages
#   multipanda_ros_module(NAME SOURCES ... DEPS ...)                      loaded with dlopen; exports only what says so
#   multipanda_ros_program(NAME SOURCES ... DEPS ...)                     executable
#   multipanda_ros_test(NAME SOURCES ... DEPS ... [LABELS ...])           GoogleTest program
# Only modules, programs and tests are linked, so only they get the link options for the wheels.
set(multipanda_ros_default ON)
if(MULTIPANDA_SANITIZER)  # the wheels' libraries were not built with sanitizers
  set(multipanda_ros_default OFF)
endif()
option(MULTIPANDA_ROS "ROS 2 interfaces (multipanda run --ros)" ${multipanda_ros_default})
option(MULTIPANDA_INSTALLED_MESSAGES "Use an installed multipanda_msgs in place of the one in ros/ (colcon)" OFF)
if(NOT MULTIPANDA_ROS)
  # Remove the results of an earlier build with ROS in the same folder.
  file(REMOVE ${CMAKE_BINARY_DIR}/libmultipanda_ros.so)
  file(REMOVE_RECURSE ${CMAKE_BINARY_DIR}/python)
  return()
endif()

set(MULTIPANDA_ROS_WHEELS OFF)
if("$ENV{AMENT_PREFIX_PATH}" STREQUAL "")
  set(MULTIPANDA_ROS_WHEELS ON)
  if(NOT EXISTS "${MULTIPANDA_VENV}/share/rcl/cmake/rclConfig.cmake")
    message(FATAL_ERROR "ROS 2 is neither in ${MULTIPANDA_VENV} nor sourced in this shell. Run ./multipanda setup, source a "
                        "ROS 2 installation's setup.bash, or build without ROS (-DMULTIPANDA_ROS=OFF).")
  endif()
  # The wheels turn the environment into a ROS 2 prefix. The message generators run in its Python.
  set(ENV{AMENT_PREFIX_PATH} "${MULTIPANDA_VENV}")
  list(PREPEND CMAKE_PREFIX_PATH "${MULTIPANDA_VENV}")
  list(PREPEND CMAKE_MODULE_PATH "${CMAKE_CURRENT_LIST_DIR}/wheels")
  set(Python3_EXECUTABLE "${MULTIPANDA_VENV}/bin/python")
  set(Python3_FIND_VIRTUALENV ONLY)
  file(GLOB MULTIPANDA_ROS_LIBRARY_DIRS LIST_DIRECTORIES true "${MULTIPANDA_SITE_PACKAGES}/ros_*.libs")
  list(PREPEND MULTIPANDA_ROS_LIBRARY_DIRS "${MULTIPANDA_VENV}/lib")
endif()

# The targets exported by the wheels contain folders of the machine that built them.
function(multipanda_clean_imported_targets)
  if(NOT MULTIPANDA_ROS_WHEELS)
    return()
  endif()
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    foreach(property INTERFACE_INCLUDE_DIRECTORIES INTERFACE_LINK_LIBRARIES)
      get_target_property(values ${target} ${property})
      if(values MATCHES "/opt/python|lttng-ust|/usr/lib64")
        list(FILTER values EXCLUDE REGEX "/opt/python|lttng-ust|/usr/lib64")
        set_target_properties(${target} PROPERTIES ${property} "${values}")
      endif()
    endforeach()
  endforeach()
endfunction()

set(MULTIPANDA_ROS_PACKAGES action_msgs builtin_interfaces diagnostic_msgs geometry_msgs rcl_interfaces rosgraph_msgs
    sensor_msgs std_msgs std_srvs trajectory_msgs unique_identifier_msgs)
set(multipanda_ros_was_shared ${BUILD_SHARED_LIBS})
find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
foreach(package ament_cmake rcl rcl_action service_msgs ${MULTIPANDA_ROS_PACKAGES})
  if(package STREQUAL service_msgs)
    find_package(service_msgs QUIET)  # not in Humble
  else()
    find_package(${package} REQUIRED)
  endif()
endforeach()
if(MULTIPANDA_ROS_WHEELS)
  foreach(package rosidl_cmake rosidl_adapter rosidl_generator_type_description rosidl_generator_c rosidl_generator_cpp
                  rosidl_typesupport_fastrtps_c rosidl_typesupport_fastrtps_cpp rosidl_typesupport_c rosidl_typesupport_cpp
                  rosidl_generator_py)
    find_package(${package} REQUIRED)
  endforeach()
else()
  find_package(rosidl_default_generators REQUIRED)
endif()
set(BUILD_SHARED_LIBS ${multipanda_ros_was_shared})  # ament enables it for the whole project
multipanda_clean_imported_targets()

# Call before rosidl_generate_interfaces(), in the same folder, to shorten the build: the wheels contain one middleware, so
# its type supports suffice (and those for C that Python requests when it opens an action); the small generated files are
# compiled in batches and with little optimization.
macro(multipanda_prepare_generators)
  if(MULTIPANDA_ROS_WHEELS)
    list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX introspection_cpp)
    set(STATIC_ROSIDL_TYPESUPPORT_CPP rosidl_typesupport_fastrtps_cpp)
  endif()
  set(CMAKE_UNITY_BUILD ON)
  set(CMAKE_UNITY_BUILD_BATCH_SIZE 12)
  add_compile_options(-O1 -w)
endmacro()

# Call after it: type descriptions use the same names in every file, and more packages have been found.
function(multipanda_finish_generators package)
  get_target_property(sources ${package}__rosidl_generator_c SOURCES)
  list(FILTER sources INCLUDE REGEX "__description\\.c$")
  set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  multipanda_clean_imported_targets()
  # Type supports are loaded by name, which works for libraries that are loaded already.
  target_link_options(${package}__rosidl_typesupport_c PRIVATE -Wl,--no-as-needed)
  foreach(kind fastrtps_c introspection_c)
    if(TARGET ${package}__rosidl_typesupport_${kind})
      target_link_libraries(${package}__rosidl_typesupport_c PRIVATE ${package}__rosidl_typesupport_${kind})
    endif()
  endforeach()
endfunction()

# Interfaces that no installed package provides are built here; the others are imported.
set(MULTIPANDA_OWN_INTERFACES "")
foreach(package multipanda_msgs control_msgs tf2_msgs visualization_msgs)
  set(found FALSE)
  if(NOT package STREQUAL multipanda_msgs OR MULTIPANDA_INSTALLED_MESSAGES)
    find_package(${package} QUIET)
    set(found ${${package}_FOUND})
  endif()
  if(found)
    list(APPEND MULTIPANDA_ROS_PACKAGES ${package})
  else()
    list(APPEND MULTIPANDA_OWN_INTERFACES ${package})
  endif()
endforeach()
multipanda_clean_imported_targets()

# rcl and the C++ structs of all messages; SYSTEM, because warnings in generated headers are not ours.
add_library(multipanda_ros_packages INTERFACE)
target_link_libraries(multipanda_ros_packages INTERFACE rcl::rcl rcl_action::rcl_action)
foreach(package IN LISTS MULTIPANDA_ROS_PACKAGES)
  target_link_libraries(multipanda_ros_packages INTERFACE ${package}::${package}__rosidl_typesupport_cpp)
endforeach()
foreach(package IN LISTS MULTIPANDA_OWN_INTERFACES)
  target_link_libraries(multipanda_ros_packages INTERFACE ${package}__rosidl_typesupport_cpp)
  foreach(kind generator_c generator_cpp)
    target_include_directories(multipanda_ros_packages SYSTEM INTERFACE
      $<TARGET_PROPERTY:${package}__rosidl_${kind},INTERFACE_INCLUDE_DIRECTORIES>)
  endforeach()
endforeach()

# Options to find the wheels' libraries at link time and at load time. RPATH instead of RUNPATH, because the libraries
# depend on each other without RPATHs of their own.
function(multipanda_ros_link name)
  target_link_libraries(${name} PRIVATE multipanda_ros_packages)
  if(MULTIPANDA_ROS_WHEELS)
    set(options -Wl,--disable-new-dtags)
    get_target_property(type ${name} TYPE)
    if(type STREQUAL EXECUTABLE)
      # Fast DDS and the URDF parser each bring a tinyxml2 with the same symbols, and the first one loaded serves both.
      # A module is loaded with RTLD_DEEPBIND instead.
      file(GLOB tinyxml2 "${MULTIPANDA_SITE_PACKAGES}/ros_fastdds.libs/libtinyxml2-*.so*")
      list(APPEND options -Wl,--push-state,--no-as-needed ${tinyxml2} -Wl,--pop-state)
    endif()
    foreach(directory IN LISTS MULTIPANDA_ROS_LIBRARY_DIRS)
      list(APPEND options "-Wl,-rpath-link,${directory}")
    endforeach()
    target_link_options(${name} PRIVATE ${options})
    set_property(TARGET ${name} APPEND PROPERTY BUILD_RPATH ${CMAKE_BUILD_RPATH} ${MULTIPANDA_ROS_LIBRARY_DIRS})
    # librcl needs Python's symbols. The module has stand-ins (ros/adapter/no_python.cpp), to be loaded without libpython.
    set(loaded "")
    if(NOT type STREQUAL MODULE_LIBRARY)
      list(APPEND loaded ${Python3_LIBRARIES})
    endif()
    # Type supports are loaded by name, and their dependencies are then searched without this RPATH: load all of them.
    foreach(package IN LISTS MULTIPANDA_ROS_PACKAGES)
      foreach(kind fastrtps_cpp introspection_cpp)
        list(APPEND loaded "${MULTIPANDA_VENV}/lib/lib${package}__rosidl_typesupport_${kind}.so")
      endforeach()
    endforeach()
    target_link_libraries(${name} PRIVATE -Wl,--push-state,--no-as-needed ${loaded} -Wl,--pop-state)
  endif()
endfunction()

function(multipanda_ros_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS;PRIVATE_DEPS" ${ARGN})
  multipanda_library(${name} SOURCES ${ARG_SOURCES} DEPS ${ARG_DEPS} multipanda_ros_packages
                     PRIVATE_DEPS ${ARG_PRIVATE_DEPS})
endfunction()

function(multipanda_ros_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_library(${name} MODULE ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR})
  # Hidden symbols: librcl brings its own spdlog, and two visible ones crash.
  set_target_properties(${name} PROPERTIES CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  target_link_options(${name} PRIVATE -Wl,--exclude-libs,ALL)
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} multipanda_flags)
  multipanda_ros_link(${name})
endfunction()

function(multipanda_ros_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE ${ARG_DEPS} multipanda_flags)
  multipanda_ros_link(${name})
endfunction()

function(multipanda_ros_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS;LABELS" ${ARGN})
  multipanda_test(${name} SOURCES ${ARG_SOURCES} DEPS ${ARG_DEPS} LABELS ros ${ARG_LABELS})
  multipanda_ros_link(${name})
endfunction()

include(${CMAKE_CURRENT_LIST_DIR}/ros_compat.cmake)
