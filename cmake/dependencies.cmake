# Dependencies come from Debian packages or from the wheels in the Python environment (.venv).
set(MULTIPANDA_VENV "${CMAKE_SOURCE_DIR}/.venv" CACHE PATH "Python environment with the wheels of requirements.txt")
file(GLOB MULTIPANDA_SITE_PACKAGES LIST_DIRECTORIES true "${MULTIPANDA_VENV}/lib/python3*/site-packages")
if(NOT MULTIPANDA_SITE_PACKAGES)
  message(FATAL_ERROR "No Python environment at ${MULTIPANDA_VENV}: run ./multipanda setup, or set MULTIPANDA_VENV.")
endif()
# A built program finds its own files like an installed one, in share/ above it (common/own_files.hpp): here by links.
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/share)
file(CREATE_LINK ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/share/multipanda SYMBOLIC)
file(CREATE_LINK ${MULTIPANDA_VENV} ${CMAKE_BINARY_DIR}/share/multipanda-venv SYMBOLIC)
list(PREPEND CMAKE_PREFIX_PATH "${MULTIPANDA_SITE_PACKAGES}/cmeel.prefix")

find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
# A copy of Eigen's headers with one replaced file; eigen_indexed_view.h.in has the reason.
get_target_property(MULTIPANDA_EIGEN Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
file(COPY ${MULTIPANDA_EIGEN}/ DESTINATION ${CMAKE_BINARY_DIR}/eigen PATTERN IndexedViewMethods.h EXCLUDE)
configure_file(${CMAKE_CURRENT_LIST_DIR}/eigen_indexed_view.h.in
               ${CMAKE_BINARY_DIR}/eigen/Eigen/src/plugins/IndexedViewMethods.h COPYONLY)
set_target_properties(Eigen3::Eigen PROPERTIES INTERFACE_INCLUDE_DIRECTORIES ${CMAKE_BINARY_DIR}/eigen)
find_package(yaml-cpp REQUIRED)
find_package(fmt REQUIRED)
find_package(CLI11 REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(GTest REQUIRED)
find_library(ZSTD_LIBRARY zstd REQUIRED)
find_path(ZSTD_INCLUDE_DIR zstd.h REQUIRED)
add_library(multipanda_zstd INTERFACE)
target_include_directories(multipanda_zstd SYSTEM INTERFACE ${ZSTD_INCLUDE_DIR})
target_link_libraries(multipanda_zstd INTERFACE ${ZSTD_LIBRARY})

# yaml-cpp 0.7 and 0.8 name their target differently.
add_library(multipanda_yaml INTERFACE)
if(TARGET yaml-cpp::yaml-cpp)
  target_link_libraries(multipanda_yaml INTERFACE yaml-cpp::yaml-cpp)
else()
  target_link_libraries(multipanda_yaml INTERFACE yaml-cpp)
endif()

add_library(mujoco::headers INTERFACE IMPORTED)
target_include_directories(mujoco::headers INTERFACE "${MULTIPANDA_SITE_PACKAGES}/mujoco/include")

if(NOT MULTIPANDA_SIMULATOR)
  include(${CMAKE_CURRENT_LIST_DIR}/arms.cmake)
  return()
endif()
if(CMAKE_CXX_COMPILER_ID STREQUAL Clang)  # Pinocchio's package requires OpenMP, which is not used here: GCC's suffices
  set(OpenMP_CXX_FLAGS -fopenmp=libgomp CACHE STRING "")
  set(OpenMP_CXX_LIB_NAMES gomp CACHE STRING "")
  set(OpenMP_gomp_LIBRARY gomp CACHE STRING "")
endif()
find_package(pinocchio REQUIRED)
find_package(assimp REQUIRED)  # reads the meshes of URDFs; comes with coal
find_package(benchmark REQUIRED)

# MuJoCo's wheel has only libmujoco.so.<version>, no bare .so and no CMake package.
file(GLOB MUJOCO_LIBRARY "${MULTIPANDA_SITE_PACKAGES}/mujoco/libmujoco.so.4*")
if(NOT MUJOCO_LIBRARY)
  message(FATAL_ERROR "MuJoCo 4 is not in ${MULTIPANDA_SITE_PACKAGES}/mujoco: run ./multipanda setup.")
endif()
string(REGEX MATCH "[0-9.]+$" MULTIPANDA_MUJOCO "${MUJOCO_LIBRARY}")
add_library(mujoco::mujoco SHARED IMPORTED)
set_target_properties(mujoco::mujoco PROPERTIES IMPORTED_LOCATION "${MUJOCO_LIBRARY}"
                      INTERFACE_INCLUDE_DIRECTORIES "${MULTIPANDA_SITE_PACKAGES}/mujoco/include")
# With this RPATH the program finds the libraries in .venv without environment variables.
set(CMAKE_BUILD_RPATH "${MULTIPANDA_SITE_PACKAGES}/cmeel.prefix/lib;${MULTIPANDA_SITE_PACKAGES}/mujoco")
