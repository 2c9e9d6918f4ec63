# The message packages of multipanda_ros2 and franka_ros2 (docs/multipanda_compat.md) are used where this build finds
# them (a sourced ROS 2 installation, or CMAKE_PREFIX_PATH); without them there is only a refusal of `ros: {compat: ...}`.
set(MULTIPANDA_COMPAT_PACKAGES "")
find_package(rosidl_typesupport_introspection_cpp REQUIRED)
foreach(package franka_msgs multi_mode_control_msgs)
  find_package(${package} QUIET)
  if(TARGET ${package}::${package}__rosidl_typesupport_introspection_cpp)
    list(APPEND MULTIPANDA_COMPAT_PACKAGES ${package})
  endif()
endforeach()
multipanda_clean_imported_targets()
set(BUILD_SHARED_LIBS ${multipanda_ros_was_shared})

# Makes the program load the packages' type supports: ros/adapter/compat looks types up by name, but only in what is
# loaded, so that no library built for another ROS 2 gets in.
#   multipanda_compat_link(NAME PACKAGES...)
function(multipanda_compat_link name)
  set(libraries "")
  foreach(package IN LISTS ARGN)
    foreach(kind typesupport_cpp typesupport_fastrtps_cpp typesupport_introspection_cpp)
      if(TARGET ${package}::${package}__rosidl_${kind})
        list(APPEND libraries $<TARGET_FILE:${package}::${package}__rosidl_${kind}>)
      elseif(TARGET ${package}__rosidl_${kind})
        add_dependencies(${name} ${package}__rosidl_${kind})
        list(APPEND libraries $<TARGET_FILE:${package}__rosidl_${kind}>)
        set_property(TARGET ${name} APPEND PROPERTY BUILD_RPATH $<TARGET_FILE_DIR:${package}__rosidl_${kind}>)
      endif()
    endforeach()
  endforeach()
  if(libraries)
    target_link_libraries(${name} PRIVATE -Wl,--push-state,--no-as-needed ${libraries} -Wl,--pop-state)
  endif()
endfunction()

# As multipanda_prepare_generators(), with the type support that is read at run time, and without Python.
macro(multipanda_prepare_compat_generators)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "generator_py")
  if(MULTIPANDA_ROS_WHEELS)
    set(STATIC_ROSIDL_TYPESUPPORT_CPP rosidl_typesupport_fastrtps_cpp)
  endif()
  set(CMAKE_UNITY_BUILD ON)
  set(CMAKE_UNITY_BUILD_BATCH_SIZE 12)
  add_compile_options(-O1 -w)
endmacro()

# Gives a test the messages of our own that have the shapes of others.
function(multipanda_compat_test name)
  foreach(kind generator_c generator_cpp)
    target_include_directories(${name} SYSTEM PRIVATE
      $<TARGET_PROPERTY:compat_test_msgs__rosidl_${kind},INTERFACE_INCLUDE_DIRECTORIES>)
  endforeach()
  add_dependencies(${name} compat_test_msgs__cpp)
  multipanda_compat_link(${name} compat_test_msgs)
endfunction()
