#include <algorithm>
#include <assimp/Importer.hpp>
#include <assimp/config.h>
#include <assimp/scene.h>
#include <stdexcept>
#include <string>

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

std::vector<Vector3> mesh_points(const std::filesystem::path& file, const Vector3& scale) {
  Assimp::Importer importer;
  // A URDF's mesh is used as it is written; Collada's "up" is for pictures.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* scene = importer.ReadFile(file.string(), 0);
  std::vector<Vector3> points;
  if (scene != nullptr && scene->mRootNode != nullptr) {
    collect(*scene, *scene->mRootNode, aiMatrix4x4(), scale, points);
  }
  if (points.empty()) {
    throw std::invalid_argument("the mesh " + file.string() +
                                " cannot be read: " + importer.GetErrorString());
  }
  for (const auto& p : points) {
    if (!p.allFinite())
      throw std::invalid_argument("the mesh " + file.string() + " has a point that is not finite");
  }
  // In STL files every triangle has its own corners.
  const auto before = [](const Vector3& a, const Vector3& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
  };
  std::sort(points.begin(), points.end(), before);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace multipanda
