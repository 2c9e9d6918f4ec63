# The ROS 2 interfaces in the wheel: lib/ros has the module that `run --ros` loads, the libraries of the messages that no
# published distribution has, and in python/ their Python packages. The ROS 2 libraries come with the extra `ros`;
# packaging/link_ros.py sets where they are found. Only a build against the wheels (requirements-ros.txt) has them.
set(targets multipanda_ros)
foreach(package IN LISTS MULTIPANDA_OWN_INTERFACES)
  list(APPEND targets ${package}__rosidl_generator_c ${package}__rosidl_generator_py)
  foreach(kind c cpp fastrtps_c fastrtps_cpp introspection_c)
    list(APPEND targets ${package}__rosidl_typesupport_${kind})
  endforeach()
  # Behind the link of that name: CMake would install the link.
  file(REAL_PATH ${CMAKE_BINARY_DIR}/python/${package} messages)
  install(DIRECTORY ${messages}/ DESTINATION lib/ros/python/${package} COMPONENT package
          FILES_MATCHING PATTERN "*.py" PATTERN "__pycache__" EXCLUDE)
  # Python imports this one alone; it finds the others by name.
  list(APPEND extensions ${package}_s__rosidl_typesupport_c)
  install(TARGETS ${package}_s__rosidl_typesupport_c
          LIBRARY DESTINATION lib/ros/python/${package} COMPONENT package)
endforeach()
set_target_properties(${targets} PROPERTIES INSTALL_RPATH "$ORIGIN:$ORIGIN/..")
set_target_properties(${extensions} PROPERTIES INSTALL_RPATH "$ORIGIN/../..")
install(TARGETS ${targets} LIBRARY DESTINATION lib/ros COMPONENT package)

# On a computer without them the module would not be loaded.
if(MULTIPANDA_COMPAT_PACKAGES)
  list(JOIN MULTIPANDA_COMPAT_PACKAGES ", " compat_packages)
  set(compat_refusal "this build needs ${compat_packages}: make packages from one with -DMULTIPANDA_COMPAT=OFF")
  install(CODE "message(FATAL_ERROR \"${compat_refusal}\")" COMPONENT package)
endif()

# A client to begin with, and what the middleware is told by default.
install(DIRECTORY ${CMAKE_SOURCE_DIR}/examples/ros DESTINATION share/multipanda/examples COMPONENT package)
install(FILES ${CMAKE_SOURCE_DIR}/ros/rcl/fastdds_loopback.xml ${CMAKE_SOURCE_DIR}/ros/rcl/fastdds_profile.xml
        DESTINATION share/multipanda/ros/rcl COMPONENT package)
