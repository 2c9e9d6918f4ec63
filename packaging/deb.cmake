# CPack's settings of the .deb; packaging/make_packages.py adds version, contents and what it depends on.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME multipanda)
set(CPACK_PACKAGE_VENDOR "multipanda")
set(CPACK_PACKAGE_CONTACT "The multipanda developers <dev@example.com>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Any number of torque-controlled Franka arms from one process at 1 kHz")
set(CPACK_PACKAGE_DESCRIPTION "multipanda switches control laws while the arms move. The same scene file runs on simulated, \
virtual and real arms. The package contains the program, models, scenes, headers and the Python package.")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE amd64)
# The program needs none of these: Python is for `import multipanda` and for pages, OSMesa for their pictures.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "python3 (>= 3.10), python3-numpy, python3-matplotlib, libosmesa6")
set(CPACK_PACKAGING_INSTALL_PREFIX "/")
set(CPACK_STRIP_FILES OFF)  # auditwheel has stripped and patched them
