// Stand-ins for Python symbols that the libraries of librcl's wheel need: each message package has a
// conversion to Python, which a program without Python never calls. With them the module loads without
// libpython, and next to any version of Python.
#include <cstdlib>

#define MULTIPANDA_EXPORTED extern "C" __attribute__((visibility("default")))
#define MULTIPANDA_STAND_IN(name) \
  MULTIPANDA_EXPORTED void name() { std::abort(); }

// Names that begin so are reserved for Python, which is absent here.
// NOLINTBEGIN(bugprone-reserved-identifier,misc-use-internal-linkage)
MULTIPANDA_STAND_IN(PyBool_FromLong)
MULTIPANDA_STAND_IN(PyBuffer_Release)
MULTIPANDA_STAND_IN(PyBuffer_ToContiguous)
MULTIPANDA_STAND_IN(PyBytes_FromStringAndSize)
MULTIPANDA_STAND_IN(PyErr_SetString)
MULTIPANDA_STAND_IN(PyFloat_FromDouble)
MULTIPANDA_STAND_IN(PyImport_ImportModule)
MULTIPANDA_STAND_IN(PyList_New)
MULTIPANDA_STAND_IN(PyList_SetItem)
MULTIPANDA_STAND_IN(PyLong_AsLong)
MULTIPANDA_STAND_IN(PyLong_AsLongLong)
MULTIPANDA_STAND_IN(PyLong_AsSize_t)
MULTIPANDA_STAND_IN(PyLong_AsUnsignedLong)
MULTIPANDA_STAND_IN(PyLong_AsUnsignedLongLong)
MULTIPANDA_STAND_IN(PyLong_FromLong)
MULTIPANDA_STAND_IN(PyLong_FromLongLong)
MULTIPANDA_STAND_IN(PyLong_FromUnsignedLong)
MULTIPANDA_STAND_IN(PyLong_FromUnsignedLongLong)
MULTIPANDA_STAND_IN(PyObject_CallFunctionObjArgs)
MULTIPANDA_STAND_IN(PyObject_CallObject)
MULTIPANDA_STAND_IN(PyObject_CheckBuffer)
MULTIPANDA_STAND_IN(PyObject_GetAttrString)
MULTIPANDA_STAND_IN(PyObject_GetBuffer)
MULTIPANDA_STAND_IN(PyObject_SetAttrString)
MULTIPANDA_STAND_IN(PyObject_Size)
MULTIPANDA_STAND_IN(PySequence_Fast)
MULTIPANDA_STAND_IN(PySequence_Size)
MULTIPANDA_STAND_IN(PyUnicode_AsUTF8String)
MULTIPANDA_STAND_IN(PyUnicode_DecodeUTF8)
MULTIPANDA_STAND_IN(_Py_Dealloc)

// Only the addresses are used.
MULTIPANDA_EXPORTED void* PyExc_RuntimeError;
MULTIPANDA_EXPORTED void* _Py_TrueStruct;
void* PyExc_RuntimeError = nullptr;
void* _Py_TrueStruct = nullptr;
// NOLINTEND(bugprone-reserved-identifier,misc-use-internal-linkage)
