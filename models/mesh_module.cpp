// The library libmultipanda_meshes.so: assimp, which reads the meshes of URDFs.
#include <assimp/Importer.hpp>
#include <assimp/config.h>
#include <assimp/scene.h>
#include <stdexcept>

#include "models/capsule_fit.hpp"

namespace multipanda {
namespace {

void collect(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, const Vector3& scale,
             std::vector<Vector3>& points) {
  const aiMatrix4x4 X = parent * node.mTransformation;
  for (unsigned k = 0; k < node.mNumMeshes; ++k) {
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[k]];
    for (unsigned i = 0; i < mesh.mNumVertices; ++i) {
      const aiVector3D p = X * mesh.mVertices[i];
      points.push_back(Vector3(p.x, p.y, p.z).cwiseProduct(scale));
    }
  }
  for (unsigned k = 0; k < node.mNumChildren; ++k) collect(scene, *node.mChildren[k], X, scale, points);
}

}  // namespace
}  // namespace multipanda

extern "C" [[gnu::visibility("default")]] void multipanda_read_mesh(
    const std::filesystem::path& file, const multipanda::Vector3& scale,
    std::vector<multipanda::Vector3>& points) {
  Assimp::Importer importer;
  // A URDF's mesh is used as written; Collada's "up" only matters for display.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* scene = importer.ReadFile(file.string(), 0);
  if (scene != nullptr && scene->mRootNode != nullptr)
    multipanda::collect(*scene, *scene->mRootNode, aiMatrix4x4(), scale, points);
  if (points.empty()) {
    throw std::invalid_argument("the mesh " + file.string() +
                                " cannot be read: " + importer.GetErrorString());
  }
}
