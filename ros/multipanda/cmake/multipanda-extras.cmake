# multipanda::host: core, arms and ROS adapter; see ros/host/*.hpp.
find_package(multipanda_msgs REQUIRED)
find_package(rcl REQUIRED)
find_package(rcl_interfaces REQUIRED)
if(NOT TARGET multipanda::host)
  add_library(multipanda::host SHARED IMPORTED)
  set_target_properties(multipanda::host PROPERTIES
    IMPORTED_LOCATION "${multipanda_DIR}/../../../lib/libmultipanda_host.so"
    INTERFACE_INCLUDE_DIRECTORIES "${multipanda_DIR}/../../../include/multipanda"
    INTERFACE_COMPILE_FEATURES cxx_std_20
    INTERFACE_LINK_LIBRARIES
      "rcl::rcl;rcl_interfaces::rcl_interfaces__rosidl_generator_cpp;multipanda_msgs::multipanda_msgs__rosidl_generator_cpp")
endif()
